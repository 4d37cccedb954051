//! The table of all settings.

use serde_json::Value as Json;

use super::{Settings, Value, Word};

/// The kind of a setting, which decides where it may stand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Group {
    Scene,
    Run,
    Picture,
    Quality,
    Devices,
    Tests,
}

/// A setting: its name, its help, and access to its value.
pub struct Setting {
    pub key: &'static str,
    pub group: Group,
    /// Lines of the help. The first one is a summary without a full stop.
    pub help: &'static [&'static str],
    /// Returns the form of a value, such as `N`.
    pub form: &'static str,
    /// Returns the words that the value may be; empty for numbers.
    pub words: fn() -> Vec<Word>,
    pub(super) parse: fn(&mut Settings, &str) -> Result<(), String>,
    pub(super) value: fn(&Settings) -> String,
    pub(super) json: fn(&Settings) -> Json,
    /// The character between the items of a list; `None` for single values.
    pub separator: Option<char>,
    /// Returns the assignment without which the setting has no effect in any frame, unless it is there.
    pub(super) needs: fn(&Settings) -> Option<&'static str>,
    /// Commands in which the setting has an effect; empty for all.
    pub(super) of: &'static [&'static str],
}

impl Setting {
    /// Returns the setting with this name.
    pub fn of_key(key: &str) -> Option<&'static Self> {
        Settings::TABLE.iter().find(|setting| setting.key == key)
    }

    /// Returns the first line of the help.
    pub fn summary(&self) -> &'static str {
        self.help[0].trim()
    }

    /// Returns the whole help, with a paragraph after the summary.
    pub fn text(&self) -> String {
        let more: Vec<&str> = self.help[1..].iter().map(|line| line.trim()).filter(|line| !line.is_empty()).collect();
        if more.is_empty() { self.summary().to_owned() } else { format!("{}\n\n{}", self.summary(), more.join(" ")) }
    }

    /// Returns the text of the default value.
    pub fn default(&self) -> String {
        (self.value)(&Settings::default())
    }

    /// Returns the value: numbers and lists as such, all others as text.
    pub fn json(&self, settings: &Settings) -> Json {
        (self.json)(settings)
    }

    /// Checks the form of a text.
    ///
    /// # Errors
    /// A message that follows the setting's name.
    pub fn check(&self, text: &str) -> Result<(), String> {
        (self.parse)(&mut Settings::default(), text)
    }

    /// Returns true if the setting can have an effect in a command. [`CONTACT_SHEET`] and [`NO_SHOT`] count as
    /// commands.
    pub fn is_of(&self, command: &str) -> bool {
        let is_of_scene = self.group == Group::Scene;
        match command {
            _ if !self.of.is_empty() => self.of.contains(&command),
            "info" | "export" => is_of_scene,
            CONTACT_SHEET => is_of_scene || ["traversal", "max_dispatch_ms"].contains(&self.key),
            NO_SHOT => false,
            _ => true,
        }
    }

    /// Returns true if a shot's table `[render]` may have the setting. Devices are those of a machine, and the gaze has
    /// a table of its own.
    pub fn is_of_shots(&self) -> bool {
        matches!(self.group, Group::Picture | Group::Quality) && self.key != "gaze"
    }
}

/// `export -o FILE.png`, whose pictures have a fixed quality.
pub const CONTACT_SHEET: &str = "a contact sheet";
/// `info` without a shot, which reads no settings.
pub const NO_SHOT: &str = "info without a shot";

/// Access to a setting, which the table keeps as functions without captures.
pub(super) fn parsed<T: Value>(to: &mut T, text: &str) -> Result<(), String> {
    *to = T::parse(text)?;
    Ok(())
}

/// Declares [`Settings`](super::Settings) and its table.
macro_rules! settings {
    (
        $($group:ident {$(
            $(#[doc = $help:literal])+
            $key:ident: $type:ty = $default:expr $(, needs $needs:ident)? $(, of $of:expr)?;
        )+})+
    ) => {
        /// All settings of a run.
        #[derive(Clone, Debug, PartialEq)]
        pub struct Settings {$($(
            $(#[doc = $help])+
            pub $key: $type,
        )+)+}

        impl Default for Settings {
            fn default() -> Self {
                Self {$($($key: $default,)+)+}
            }
        }

        impl Settings {
            /// All settings, in the order of their help.
            pub const TABLE: &'static [Setting] = &[
                $($(table::setting!($group $key: $type, &[$($help),+], [$($needs)?], [$($of)?]),)+)+
            ];
        }
    };
}

/// An entry of the table.
macro_rules! setting {
    ($group:ident $key:ident: $type:ty, $help:expr, [$($needs:ident)?], [$($of:expr)?]) => {
        Setting {
            key: stringify!($key),
            group: Group::$group,
            help: $help,
            form: <$type as Value>::FORM,
            words: <$type as Value>::words,
            parse: |settings, text| table::parsed(&mut settings.$key, text),
            value: |settings| settings.$key.text(),
            json: |settings| settings.$key.json(),
            separator: if <$type as Value>::IS_LIST { Some(<$type as Value>::SEPARATOR) } else { None },
            needs: |_settings| {
                $(if let Some(needs) = needs::$needs(_settings) { return Some(needs); })?
                None
            },
            of: {
                let _of: &[&str] = &[];
                $(let _of = $of;)?
                _of
            },
        }
    };
}
pub(super) use setting;
pub(super) use settings;
