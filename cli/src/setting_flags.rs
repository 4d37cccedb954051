//! Command-line flags of settings: `--set KEY=VALUE` for all of them, and a flag for those that a command lists.

use std::ops::{Deref, DerefMut};

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser, ValueParser};
use clap::error::ErrorKind;
use clap::{Arg, ArgAction, ArgMatches, Args, Command, FromArgMatches};

use super::headings::{DEVICES, OUTPUT, QUALITY, SCENE, TESTS};
use diptych::frame::settings::{Chosen, Group, Setting, Settings, Value, Word};
use diptych::quality::{Quality, SettingError};

/// The settings of a command line.
#[derive(Clone, Debug, Default)]
pub struct SettingFlags(Chosen);

impl From<Chosen> for SettingFlags {
    fn from(chosen: Chosen) -> Self {
        Self(chosen)
    }
}

impl Deref for SettingFlags {
    type Target = Chosen;

    fn deref(&self) -> &Chosen {
        &self.0
    }
}

impl DerefMut for SettingFlags {
    fn deref_mut(&mut self) -> &mut Chosen {
        &mut self.0
    }
}

/// Commands, and the settings for which they have flags.
pub const FLAGS: [(&str, &str); 9] = [
    (
        "render",
        "position target yfov views sources baseline convergence metres_per_unit gaze exposure environment animation \
         time fps allow_outside size spp bounces denoiser iterations foveation reproject cache noise time_limit seed seam devices threads_per_device balance ratios aov disturb",
    ),
    ("play", LOOP),
    ("view", LOOP),
    (
        "scale",
        "views sources baseline size spp bounces denoiser iterations reproject seam devices threads_per_device balance ratios",
    ),
    ("bench", "size reproject threads_per_device balance"),
    ("study", "views size threads_per_device"),
    ("graph", "views sources size denoiser foveation reproject seam balance ratios aov"),
    ("info", "allow_outside"),
    ("export", "environment allow_outside"),
];

/// Flags of commands that keep frames inside a budget.
const LOOP: &str =
    "metres_per_unit fps size denoiser iterations foveation reproject devices threads_per_device balance disturb";

/// Settings whose flags only the long help shows.
const RARE: [&str; 15] = [
    "yfov",
    "views",
    "sources",
    "baseline",
    "convergence",
    "metres_per_unit",
    "gaze",
    "animation",
    "time",
    "allow_outside",
    "seed",
    "cache",
    "disturb",
    "time_limit",
    "noise",
];

/// Returns a command with the flags of settings, whose keys have spaces between them.
pub fn with_flags(command: Command, keys: &str) -> Command {
    let mut settings: Vec<&Setting> = keys.split(' ').filter_map(Setting::of_key).collect();
    settings.sort_by_key(|setting| setting.group as u8);
    command.args(settings.into_iter().map(flag))
}

fn flag(setting: &'static Setting) -> Arg {
    let (summary, text, default) = (setting.summary(), setting.text(), setting.default());
    let is_said =
        text.contains("[default") || default.is_empty() || default == "auto" || default == "shot" || is_switch(setting);
    let default = if is_said { String::new() } else { format!(" [default: {default}]") };
    let arg = Arg::new(id(setting)).long(setting.key.replace('_', "-"));
    let arg = arg.help(format!("{summary}{default}")).help_heading(match setting.group {
        Group::Scene | Group::Picture => SCENE,
        Group::Run => OUTPUT,
        Group::Quality => QUALITY,
        Group::Devices => DEVICES,
        Group::Tests => TESTS,
    });
    let long = text.replacen(summary, &format!("{summary}{default}"), 1);
    let arg = if text == summary { arg } else { arg.long_help(long) };
    let arg = if is_switch(setting) {
        arg.action(ArgAction::SetTrue)
    } else {
        let may_be_negative = matches!(setting.group, Group::Scene | Group::Picture);
        let arg = arg.value_name(setting.form).value_parser(parser(setting)).allow_hyphen_values(may_be_negative);
        // The setting refuses such a number with a reason.
        arg.allow_negative_numbers(true)
    };
    let arg = match setting.separator {
        Some(separator) if !(setting.words)().is_empty() => arg.action(ArgAction::Append).value_delimiter(separator),
        Some(_) => arg.action(ArgAction::Append),
        None => arg,
    };
    arg.hide_short_help(RARE.contains(&setting.key))
}

/// Prefix of the names that flags of settings have inside clap.
pub const SETTING: &str = "setting ";

/// Returns true if a flag without a value turns the setting on.
fn is_switch(setting: &Setting) -> bool {
    setting.default() == "off"
}

/// Returns the name of a setting's flag inside clap, which differs from those of options.
fn id(setting: &Setting) -> String {
    format!("{SETTING}{}", setting.key)
}

fn parser(setting: &'static Setting) -> ValueParser {
    let words = (setting.words)();
    if words.is_empty() {
        let check = |text: &str| setting.check(text).map(|()| text.to_owned());
        return ValueParser::new(check);
    }
    ValueParser::new(self::words(words))
}

fn words(words: Vec<Word>) -> PossibleValuesParser {
    let value = |(word, help): Word| match help {
        Some(help) => PossibleValue::new(word).help(help),
        // Help leaves out words without one, except for those that need none.
        None => {
            let truth = ["true", "false"].into_iter().zip(["on", "off"]).filter(|(_, switch)| *switch == word);
            let value = PossibleValue::new(word).hide(!["on", "off", "auto", "none"].contains(&word));
            value.aliases(truth.map(|(truth, _)| truth))
        }
    };
    PossibleValuesParser::new(words.into_iter().map(value))
}

impl FromArgMatches for SettingFlags {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let mut flags = Self::default();
        flags.update_from_arg_matches(matches)?;
        Ok(flags)
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        let invalid = |error: SettingError| clap::Error::raw(ErrorKind::ValueValidation, format!("{error}\n"));
        for setting in Settings::TABLE {
            // Commands without the flag do not know its name.
            if let Ok(Some(texts)) = matches.try_get_many::<String>(&id(setting)) {
                let texts: Vec<&str> = texts.map(String::as_str).collect();
                let separator = setting.separator.map_or(String::new(), String::from);
                self.0.set(setting.key, &texts.join(&separator)).map_err(invalid)?;
            }
            if let Ok(Some(true)) = matches.try_get_one::<bool>(&id(setting)) {
                self.0.set(setting.key, "on").map_err(invalid)?;
            }
        }
        let assignments = matches.get_many::<String>("set").into_iter().flatten();
        for assignment in assignments {
            self.0.assign(assignment).map_err(invalid)?;
        }
        Ok(())
    }
}

impl Args for SettingFlags {
    fn augment_args(command: Command) -> Command {
        let set = Arg::new("set").long("set").value_name("KEY=VALUE").action(ArgAction::Append).help_heading(QUALITY);
        let help = "Give a setting a value; `diptych info --settings` lists all of them";
        command.arg(set.help(help))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

/// Parses a render scale of the grid of `bench`.
pub fn render_scale(text: &str) -> Result<f64, String> {
    let scale = text.parse().ok().filter(|scale| Quality::SCALES.contains(scale));
    scale.ok_or_else(|| format!("give a number from {} to {}", Quality::SCALES.start(), Quality::SCALES.end()))
}

/// Returns a parser of values that have names, for the lists of `bench`.
pub fn named<T: Value + Clone + Send + Sync + 'static>() -> impl TypedValueParser<Value = T> {
    words(T::words()).try_map(|word| T::parse(&word))
}
