//! Settings that a user has chosen, and those left at their defaults.

use std::ops::{Deref, DerefMut};

use serde_json::{Map, Value as Json};

use super::needs::layers;
use super::{Setting, Settings, text_of};
use crate::projection::within;
use crate::quality::{Denoiser, SettingError};

/// Settings, and which of them were given explicitly.
#[derive(Clone, Debug, Default)]
pub struct Chosen {
    settings: Settings,
    given: Vec<&'static str>,
}

impl Deref for Chosen {
    type Target = Settings;

    fn deref(&self) -> &Settings {
        &self.settings
    }
}

/// Changes a value without marking it as given.
impl DerefMut for Chosen {
    fn deref_mut(&mut self) -> &mut Settings {
        &mut self.settings
    }
}

impl Chosen {
    /// Gives a setting a value.
    ///
    /// # Errors
    /// [`SettingError::Unknown`] without such a setting, and [`SettingError::Invalid`] if it cannot have the value.
    pub fn set(&mut self, key: &str, text: &str) -> Result<(), SettingError> {
        let setting = find(key)?;
        let invalid = |why| SettingError::Invalid { key: setting.key, value: text.to_owned(), why };
        (setting.parse)(&mut self.settings, text).map_err(invalid)?;
        if !self.is_given(key) {
            self.given.push(setting.key);
        }
        Ok(())
    }

    /// Resets a setting to its default, as if it had not been given.
    ///
    /// # Errors
    /// [`SettingError::Unknown`] without such a setting.
    pub fn unset(&mut self, key: &str) -> Result<(), SettingError> {
        self.set(key, &find(key)?.default())?;
        self.given.retain(|given| *given != key);
        Ok(())
    }

    /// Gives a setting a value in the form `KEY=VALUE`.
    ///
    /// # Errors
    /// The errors of [`Self::set`], and [`SettingError::NoAssignment`].
    pub fn assign(&mut self, assignment: &str) -> Result<(), SettingError> {
        let (key, text) =
            assignment.split_once('=').ok_or_else(|| SettingError::NoAssignment(assignment.to_owned()))?;
        self.set(key.trim(), text.trim())
    }

    /// Sets the values of a shot's table that a command reads. They do not count as given: they yield to values that
    /// were given, also where they would take their effect away.
    ///
    /// # Errors
    /// The errors of [`Self::set`], and [`SettingError::NotInShots`].
    pub fn default_to(&mut self, table: &Map<String, Json>, command: &str) -> Result<(), SettingError> {
        for (key, value) in table {
            let setting = find(key)?;
            if !setting.is_of_shots() {
                return Err(SettingError::NotInShots(setting.key));
            }
            let invalid = |why| SettingError::Invalid { key: setting.key, value: value.to_string(), why };
            let text = text_of(value).map_err(invalid)?;
            let mut with = self.settings.clone();
            (setting.parse)(&mut with, &text).map_err(invalid)?;
            let yields = self.is_given(key) || self.without_effect(&with) > self.without_effect(&self.settings);
            if setting.is_of(command) && !yields {
                self.settings = with;
            }
        }
        Ok(())
    }

    /// Counts the given values that would have no effect in these settings.
    fn without_effect(&self, settings: &Settings) -> usize {
        let is_idle = |key: &&&str| find(key).is_ok_and(|setting| (setting.needs)(settings).is_some());
        // A denoiser needs iterations, and layers need a filter that fills in pixels.
        let is_denoised = settings.denoiser.is_some() && self.is_given("denoiser");
        let needs_filter = is_denoised || settings.layer_radii().is_some();
        self.given.iter().filter(is_idle).count() + usize::from(needs_filter && settings.filter().is_none())
    }

    /// Returns true if the setting was given explicitly.
    pub fn is_given(&self, key: &str) -> bool {
        self.given.contains(&key)
    }

    /// Returns the names of the settings that were given explicitly.
    pub fn given(&self) -> &[&'static str] {
        &self.given
    }

    /// Checks that a command reads each setting that was given.
    ///
    /// # Errors
    /// [`SettingError::OtherCommand`].
    pub fn check_command(&self, command: &'static str) -> Result<(), SettingError> {
        let unread = self.given.iter().find(|key| find(key).is_ok_and(|setting| !setting.is_of(command)));
        unread.map_or(Ok(()), |key| Err(SettingError::OtherCommand { key, command }))
    }

    /// Checks all values, and that each given one has an effect.
    ///
    /// # Errors
    /// [`SettingError`], except for [`SettingError::OutsideEnvelope`].
    pub fn check(&self) -> Result<(), SettingError> {
        self.check_any([&self.settings])?;
        if let (Some(iterations), true) = (self.settings.iterations, self.is_given("iterations")) {
            let most = self.settings.denoiser.map_or(0, Denoiser::most_iterations);
            iterations.into_iter().try_for_each(|n| within("iterations", n, 0..=most))?;
            if let Some(needs) = layers(&self.settings).filter(|_| iterations != [iterations[0]; 3]) {
                return Err(SettingError::NoEffect { key: "iterations per layer", needs });
            }
        }
        self.settings.check()
    }

    /// Checks that each given value has an effect in one of the settings of a run.
    ///
    /// # Errors
    /// [`SettingError::NoEffect`].
    pub fn check_any<'a>(&self, all: impl IntoIterator<Item = &'a Settings> + Clone) -> Result<(), SettingError> {
        for key in &self.given {
            let needs = find(key)?.needs;
            let mut lacking = all.clone().into_iter().map(needs);
            if let Some(needs) = lacking.next().flatten().filter(|_| lacking.all(|needs| needs.is_some())) {
                return Err(SettingError::NoEffect { key, needs });
            }
        }
        Ok(())
    }

    /// Returns all values by their keys.
    pub fn json(&self) -> Map<String, Json> {
        Settings::TABLE.iter().map(|setting| (setting.key.to_owned(), setting.json(&self.settings))).collect()
    }
}

fn find(key: &str) -> Result<&'static Setting, SettingError> {
    Setting::of_key(key).ok_or_else(|| {
        let known: Vec<&str> = Settings::TABLE.iter().map(|setting| setting.key).collect();
        SettingError::Unknown { key: key.to_owned(), known: known.join(", ") }
    })
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::frame::settings::{CONTACT_SHEET, NO_SHOT};

    #[test]
    fn all_defaults_read_back() {
        for setting in Settings::TABLE {
            let mut chosen = Chosen::default();
            chosen.set(setting.key, &setting.default()).unwrap();
            assert_eq!(*chosen, Settings::default(), "{}", setting.key);
            assert!(chosen.is_given(setting.key));
            chosen.unset(setting.key).unwrap();
            assert!(*chosen == Settings::default() && chosen.given().is_empty(), "{}", setting.key);
        }
    }

    #[test]
    fn all_words_read_back() {
        for setting in Settings::TABLE {
            for (word, _) in (setting.words)() {
                let mut chosen = Chosen::default();
                chosen.set(setting.key, word).unwrap();
                assert_eq!((setting.value)(&chosen), word, "{}", setting.key);
            }
        }
    }

    #[test]
    fn rejects_settings_without_effect() {
        for (given, needs) in [
            ("denoiser=none iterations=3", "iterations"),
            ("denoiser=atrous filter_once=on", "filter_once"),
            ("reproject=off filter_once=on", "filter_once"),
            ("denoiser=none hard_shadows=off", "hard_shadows"),
            ("denoiser=none follow_mirrors=on", "follow_mirrors"),
            ("denoiser=none regularize=off", "regularize"),
            ("denoiser=none filter_textures=off", "filter_textures"),
            ("denoiser=none bypass_narrow_lobes=off", "bypass_narrow_lobes"),
            ("denoiser=svgf blind_iterations=0", "blind_iterations"),
            ("denoiser=atrous cache=on", "cache"),
            ("bounces=1 cache=off", "cache"),
            ("bounces=1 clamp=3", "clamp"),
            ("polar=fov", "polar"),
            ("runs=2", "runs"),
            ("balance=even ratios=1,2", "ratios"),
            ("foveation=visual-polar polar=fov", "polar"),
            ("unsampled_fraction=0.3", "unsampled_fraction"),
            ("seam=none halo=exchange", "halo"),
            ("iterations=2,3,5", "iterations per layer"),
            ("denoiser=none render_scale=0.5", "render_scale"),
            ("iterations=0 render_scale=0.5", "render_scale"),
        ] {
            let mut chosen = Chosen::default();
            given.split(' ').for_each(|assignment| chosen.assign(assignment).unwrap());
            match chosen.check() {
                Err(SettingError::NoEffect { key, .. }) => assert_eq!(key, needs, "{given}"),
                other => panic!("{given}: {other:?}"),
            }
        }
        // Each setting can have an effect.
        for setting in Settings::TABLE {
            let others = [
                "foveation=log-polar",
                "foveation=layers",
                "denoiser=atrous",
                "balance=static",
                "controller=pid,diptych",
            ];
            let all = others.map(|other| {
                let mut chosen = Chosen::default();
                chosen.assign(other).unwrap();
                (setting.needs)(&chosen)
            });
            assert!(all.contains(&None), "{}", setting.key);
        }
    }

    #[test]
    fn shot_tables_follow_explicit_values() {
        let table = |text: &str| serde_json::from_str::<Map<String, Json>>(text).unwrap();
        let mut chosen = Chosen::default();
        chosen.assign("spp=4").unwrap();
        let of_shot = r#"{"spp": 2, "bounces": 3, "denoiser": "atrous", "reproject": false, "iterations": [1, 2, 3]}"#;
        chosen.default_to(&table(of_shot), "render").unwrap();
        assert_eq!((chosen.spp, chosen.bounces, chosen.reproject), (4.into(), 3, false));
        assert_eq!(chosen.iterations, Some([1, 2, 3]));
        assert!(!chosen.is_given("bounces"));
        // Values of a shot may be without effect.
        chosen.default_to(&table(r#"{"iterations": 3, "filter_once": true}"#), "render").unwrap();
        chosen.check().unwrap();
        for (text, error) in [
            (r#"{"sppp": 2}"#, "there is no setting 'sppp'"),
            (r#"{"spp": "many"}"#, "spp"),
            (r#"{"spp": {}}"#, "spp"),
            (r#"{"traversal": "compute"}"#, "traversal"),
            (r#"{"gaze": [0.5, 0.5]}"#, "gaze"),
        ] {
            let found = chosen.default_to(&table(text), "render").unwrap_err().to_string();
            assert!(found.contains(error), "{found}");
        }
    }

    #[test]
    fn shot_tables_yield_to_given_values() {
        // Given values, a shot's table, and values in force.
        for (given, of_shot, expected) in [
            ("foveation=none", r#"{"foveation": "layers", "iterations": [2, 3, 5]}"#, "foveation=none"),
            ("foveation=log-polar", r#"{"foveation": "layers", "iterations": [2, 3, 5]}"#, "foveation=log-polar"),
            ("denoiser=none", r#"{"render_scale": 0.5, "foveation": "layers"}"#, "foveation=none"),
            ("denoiser=bmfr", r#"{"denoiser": "none", "iterations": 8}"#, "denoiser=bmfr"),
            ("denoiser=atrous", r#"{"iterations": 0}"#, "iterations=auto"),
            ("iterations=3", r#"{"denoiser": "none", "iterations": 0}"#, "denoiser=svgf"),
            ("render_scale=0.5", r#"{"denoiser": "none"}"#, "denoiser=svgf"),
            ("foveation=layers", r#"{"denoiser": "none"}"#, "denoiser=svgf"),
            ("cache=on", r#"{"bounces": 1}"#, "bounces=6"),
            ("polar=fov", r#"{"foveation": "log-polar"}"#, "foveation=log-polar"),
            ("spp=2", r#"{"denoiser": "none", "iterations": 0, "render_scale": 0.5}"#, "denoiser=none"),
            ("spp=2", r#"{"denoiser": "none", "foveation": "layers"}"#, "foveation=none"),
        ] {
            let mut chosen = Chosen::default();
            chosen.assign(given).unwrap();
            let of_shot: Map<String, Json> = serde_json::from_str(of_shot).unwrap();
            let _ = chosen.default_to(&of_shot, "render").map_err(|error| panic!("{given}: {error}"));
            let _ = chosen.check().map_err(|error| panic!("{given}: {error}"));
            let (key, value) = expected.split_once('=').unwrap();
            assert_eq!((find(key).unwrap().value)(&chosen), value, "{given}");
        }
        // Commands read their own settings alone.
        let mut chosen = Chosen::default();
        chosen.assign("cache=on").unwrap();
        let of_shot = serde_json::from_str(r#"{"bounces": 1, "denoiser": "svgf"}"#).unwrap();
        chosen.default_to(&of_shot, "play").unwrap();
        assert_eq!(chosen.bounces, 6);
        // Values out of range are errors.
        chosen.default_to(&serde_json::from_str(r#"{"iterations": 50}"#).unwrap(), "render").unwrap();
        assert!(chosen.check().unwrap_err().to_string().contains("iterations 50"));
    }

    #[test]
    fn commands_read_their_settings() {
        for (given, command, is_read) in [
            ("clamp=nan", "info", false),
            ("gaze=0.5,0.5", "export", false),
            ("fps=24", "export", false),
            ("environment=sky", "info", true),
            ("environment=sky", NO_SHOT, false),
            ("denoiser=none", CONTACT_SHEET, false),
            ("traversal=compute", CONTACT_SHEET, true),
            ("spp=9", "play", false),
            ("disturb=loss:dev0@1", "bench", false),
            ("disturb=loss:dev0@1", "study", false),
            ("slowdown=2", "bench", true),
            ("spp=9", "render", true),
        ] {
            let mut chosen = Chosen::default();
            chosen.assign(given).unwrap();
            assert_eq!(chosen.check_command(command).is_ok(), is_read, "{given} in {command}");
        }
    }

    #[test]
    fn numbers_alone_are_json_numbers() {
        let number = |text: &str| text.parse::<f64>().unwrap();
        for (given, expected) in [
            ("environment=0.1,0.2,0.3", json!([0.1, 0.2, 0.3])),
            ("environment=a,1.hdr", json!("a,1.hdr")),
            ("variant=007", json!("007")),
            ("scene_cache=1,2", json!("1,2")),
            ("animation=3", json!("3")),
            ("exposure=-1.86", json!(number("-1.86"))),
            ("position=0,1,2.5", json!([0, 1, 2.5])),
            ("iterations=2,3,5", json!([2, 3, 5])),
            ("devices=1", json!([1])),
            ("balance=even,measured", json!(["even", "measured"])),
            ("ratios=5,1;denoise.left=1,2", json!(["5,1", "denoise.left=1,2"])),
            ("disturb=loss:dev1@3,scene-cut@7", json!(["loss:dev1@3", "scene-cut@7"])),
            ("aov=", json!([])),
            ("cache=true", json!("on")),
            ("reproject=false", json!("off")),
        ] {
            let mut chosen = Chosen::default();
            chosen.assign(given).unwrap();
            assert_eq!(chosen.json()[given.split_once('=').unwrap().0], expected, "{given}");
        }
    }

    #[test]
    fn rejects_values_out_of_range_by_key() {
        for (given, expected) in [
            ("render_scale=nan", "render_scale NaN"),
            ("speeds=", "speeds cannot be empty"),
            ("controller=", "controller cannot be empty"),
            ("threads_per_device=0", "threads_per_device 0"),
            ("balance=static", "balance cannot be static: it needs ratios"),
            ("fps=1e-308", "fps cannot be"),
            ("fps=1e7", "fps cannot be"),
            ("iterations=11", "iterations 11"),
        ] {
            let mut chosen = Chosen::default();
            chosen.assign(given).unwrap();
            let error = chosen.check().unwrap_err().to_string();
            assert!(error.starts_with(expected), "{error}");
        }
    }
}
