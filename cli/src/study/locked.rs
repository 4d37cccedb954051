//! Settings of studies: those of the publication, and those of diptych today.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use serde::Deserialize;
use serde_json::{Map, Value as Json};

use diptych::frame::settings::{Chosen, Setting, Settings, text_of};
use diptych::quality::SettingError;

type Table = Map<String, Json>;

/// Contents of `settings.toml`.
#[derive(Deserialize)]
struct Locked {
    given: Vec<String>,
    published: Table,
    #[serde(flatten)]
    papers: BTreeMap<String, Paper>,
}

/// Settings of a paper.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Paper {
    /// Settings under all conditions.
    workload: Table,
    /// Further settings of the publication.
    published: Table,
}

#[expect(clippy::expect_used, reason = "the file is part of the program, and a test reads it")]
static LOCKED: LazyLock<Locked> =
    LazyLock::new(|| toml::from_str(include_str!("settings.toml")).expect("settings.toml is valid"));

/// Settings under which a study runs, besides those of its arrangements.
#[derive(Clone, Debug, PartialEq)]
pub struct Conditions {
    pub name: String,
    settings: Table,
}

/// A setting whose value differs between the publication and diptych today.
#[derive(Clone, Debug, PartialEq)]
pub struct Departure {
    pub key: &'static str,
    pub published: String,
    pub today: String,
}

/// Name of the publication's conditions.
pub const PUBLISHED: &str = "published";
/// Name of the conditions that are diptych's defaults.
pub const TODAY: &str = "today";

/// Returns true if the command line decides the setting, and not the study.
pub fn is_given(key: &str) -> bool {
    LOCKED.given.iter().any(|given| given == key)
}

/// Returns the conditions of a study as published.
pub fn published(study: &str) -> Conditions {
    let own = LOCKED.papers.get(study).into_iter().flat_map(|paper| paper.workload.iter().chain(&paper.published));
    let settings = LOCKED.published.iter().chain(own).map(|(key, value)| (key.clone(), value.clone())).collect();
    Conditions { name: PUBLISHED.to_owned(), settings }
}

/// Returns the conditions of a study with diptych's defaults: the workload of the study, and nothing else.
pub fn today(study: &str) -> Conditions {
    let settings = LOCKED.papers.get(study).map(|paper| paper.workload.clone()).unwrap_or_default();
    Conditions { name: TODAY.to_owned(), settings }
}

/// Returns the settings in which diptych departs from the publication.
pub fn departures(study: &str) -> Vec<Departure> {
    let text = |conditions: &Conditions, setting: &'static Setting| {
        let mut chosen = Chosen::default();
        conditions.apply(&mut chosen, &[]).ok().and_then(|()| text_of(&setting.json(&chosen)).ok())
    };
    let (published, today) = (published(study), today(study));
    let all = Settings::TABLE.iter().filter(|setting| !is_given(setting.key)).filter_map(|setting| {
        let (published, today) = (text(&published, setting)?, text(&today, setting)?);
        (published != today).then_some(Departure { key: setting.key, published, today })
    });
    all.collect()
}

impl Conditions {
    /// Returns the conditions of the publication, except for one departure.
    pub fn with(self, departure: &Departure) -> Self {
        let Departure { key, today, .. } = departure;
        let mut settings = self.settings;
        settings.insert((*key).to_owned(), today.as_str().into());
        Self { name: format!("{PUBLISHED}+{key}={today}"), settings }
    }

    /// Sets the settings, and then those of an arrangement.
    ///
    /// # Errors
    /// [`SettingError`] if a setting does not exist or cannot have its value.
    pub fn apply(&self, to: &mut Chosen, arrangement: &[(&str, &str)]) -> Result<(), SettingError> {
        for (key, value) in &self.settings {
            let invalid = |why| SettingError::Invalid { key: "settings.toml", value: value.to_string(), why };
            to.set(key, &text_of(value).map_err(invalid)?)?;
        }
        arrangement.iter().try_for_each(|(key, value)| to.set(key, value))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::STUDIES;

    #[test]
    fn studies_fix_every_setting() {
        for Setting { key, .. } in Settings::TABLE {
            assert!(
                is_given(key) != LOCKED.published.contains_key(*key),
                "{key}: add it to settings.toml, to `given` or to `published` with the value that stands for its absence"
            );
        }
        let known = LOCKED.given.iter().chain(LOCKED.published.keys());
        assert_eq!(known.count(), Settings::TABLE.len());
    }

    #[test]
    fn conditions_of_all_studies_are_valid() {
        let papers: Vec<&str> = LOCKED.papers.keys().map(String::as_str).collect();
        let mut studies: Vec<&str> = STUDIES.iter().map(|study| study.name).collect();
        studies.sort_unstable();
        assert_eq!(papers, studies);
        for study in STUDIES {
            let departures = departures(study.name);
            let each = departures.iter().map(|departure| published(study.name).with(departure));
            for conditions in [published(study.name), today(study.name)].into_iter().chain(each) {
                for arrangement in study.arrangements {
                    let mut chosen = Chosen::default();
                    conditions.apply(&mut chosen, arrangement.settings).unwrap();
                    (*chosen).check().unwrap_or_else(|e| panic!("{}, {}: {e}", study.name, arrangement.name));
                }
            }
        }
    }

    #[test]
    fn departures_are_the_techniques_of_today() {
        let of = |study| departures(study).into_iter().map(|departure| departure.key).collect::<Vec<_>>();
        assert!(of("peres").contains(&"reproject") && !of("leria").contains(&"reproject"));
        for study in STUDIES {
            let found = of(study.name);
            for key in ["hard_shadows", "filter_once", "cache", "regularize"] {
                assert!(found.contains(&key), "{}: {found:?}", study.name);
            }
            assert!(!found.contains(&"spp") && !found.contains(&"size"), "{}: {found:?}", study.name);
        }
    }
}
