//! Settings that a user has chosen, and those left at their defaults.

use std::ops::{Deref, DerefMut};

use serde_json::{Map, Value as Json};

use super::{Setting, Settings, text_of};
use crate::quality::SettingError;

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

    /// Gives a setting a value in the form `KEY=VALUE`.
    ///
    /// # Errors
    /// The errors of [`Self::set`], and [`SettingError::NoAssignment`].
    pub fn assign(&mut self, assignment: &str) -> Result<(), SettingError> {
        let (key, text) =
            assignment.split_once('=').ok_or_else(|| SettingError::NoAssignment(assignment.to_owned()))?;
        self.set(key.trim(), text.trim())
    }

    /// Sets the values of a shot's table, unless they were given already. They do not count as given.
    ///
    /// # Errors
    /// The errors of [`Self::set`], and [`SettingError::NotInShots`].
    pub fn default_to(&mut self, table: &Map<String, Json>) -> Result<(), SettingError> {
        for (key, value) in table {
            let setting = find(key)?;
            if !setting.is_of_shots() {
                return Err(SettingError::NotInShots(setting.key));
            }
            let invalid = |why| SettingError::Invalid { key: setting.key, value: value.to_string(), why };
            let text = text_of(value).map_err(invalid)?;
            if self.is_given(key) {
                setting.check(&text).map_err(invalid)?;
            } else {
                (setting.parse)(&mut self.settings, &text).map_err(invalid)?;
            }
        }
        Ok(())
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
        for key in &self.given {
            let needs = find(key)?.needs;
            if let Some(needs) = needs(&self.settings) {
                return Err(SettingError::NoEffect { key, needs });
            }
        }
        self.settings.check()
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
    use super::*;

    #[test]
    fn all_defaults_read_back() {
        for setting in Settings::TABLE {
            let mut chosen = Chosen::default();
            chosen.set(setting.key, &setting.default()).unwrap();
            assert_eq!(*chosen, Settings::default(), "{}", setting.key);
            assert!(chosen.is_given(setting.key));
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
            ("denoiser=atrous cache=on", "cache"),
            ("bounces=1 cache=off", "cache"),
            ("bounces=1 clamp=3", "clamp"),
            ("polar=fov", "polar"),
            ("foveation=visual-polar polar=fov", "polar"),
            ("unsampled_fraction=0.3", "unsampled_fraction"),
            ("seam=none halo=exchange", "halo"),
            ("iterations=2,3,5", "iterations per layer"),
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
            let all = ["foveation=log-polar", "foveation=layers"].map(|foveation| {
                let mut chosen = Chosen::default();
                chosen.assign(foveation).unwrap();
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
        chosen.default_to(&table(of_shot)).unwrap();
        assert_eq!((chosen.spp, chosen.bounces, chosen.reproject), (4.into(), 3, false));
        assert_eq!(chosen.iterations, Some([1, 2, 3]));
        assert!(!chosen.is_given("bounces"));
        // Values of a shot may be without effect.
        chosen.default_to(&table(r#"{"iterations": 3, "filter_once": true}"#)).unwrap();
        chosen.check().unwrap();
        for (text, error) in [
            (r#"{"sppp": 2}"#, "there is no setting 'sppp'"),
            (r#"{"spp": "many"}"#, "spp"),
            (r#"{"spp": {}}"#, "spp"),
            (r#"{"traversal": "compute"}"#, "traversal"),
        ] {
            let found = chosen.default_to(&table(text)).unwrap_err().to_string();
            assert!(found.contains(error), "{found}");
        }
    }
}
