//! Former names of options, which are understood for one more release.

use std::ffi::OsString;

/// Command, former and present name.
const RENAMED: [(&str, &str, &str); 8] = [
    ("render", "--scale", "--render-scale"),
    ("render", "--preset", "--peres"),
    ("scale", "--scale", "--render-scale"),
    ("bench", "--scale", "--render-scale"),
    ("bench", "--seams", "--seam-study"),
    ("bench", "--reference", "--reference-images"),
    ("bench", "--reference-dir", "--reference-cache"),
    ("compare", "--seams", "--seam-rows"),
];

/// The command line with present names, and what to say of each former one.
pub fn translate(args: Vec<OsString>) -> (Vec<OsString>, Vec<String>) {
    let command = args.get(1).cloned().unwrap_or_default();
    let repeats_study = args.iter().any(|arg| arg.to_string_lossy().starts_with("--preset"));
    let mut notes = Vec::new();
    let translated = args.into_iter().map(|arg| {
        let text = arg.to_string_lossy();
        let (name, value) = text.split_once('=').map_or((&*text, None), |(name, value)| (name, Some(value)));
        let Some(&(_, former, mut present)) = RENAMED.iter().find(|(c, former, _)| command == *c && name == *former)
        else {
            return arg;
        };
        if command == "bench" && former == "--scale" && repeats_study {
            present = "--size-factor";
        }
        notes.push(format!("{former} is called {present} now; its old name will go"));
        value.map_or_else(|| present.to_owned(), |value| format!("{present}={value}")).into()
    });
    let translated = translated.collect();
    (translated, notes)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn translated(line: &str) -> (String, usize) {
        let (args, notes) = translate(line.split(' ').map(OsString::from).collect());
        let args: Vec<_> = args.iter().map(|arg| arg.to_str().unwrap()).collect();
        (args.join(" "), notes.len())
    }

    #[test]
    fn former_names_are_understood() {
        let present = "diptych bench x --render-scale=0.5 --seam-study --reference-images d";
        assert_eq!(translated("diptych bench x --render-scale=0.5 --seams --reference d"), (present.to_owned(), 2));
        assert_eq!(translated("diptych render x --scale 0.5"), ("diptych render x --render-scale 0.5".to_owned(), 1));
        let study = "diptych bench --preset peres --size-factor 0.5";
        assert_eq!(translated("diptych bench --preset peres --scale 0.5"), (study.to_owned(), 1));
    }

    #[test]
    fn all_else_is_left_alone() {
        for line in ["diptych", "diptych render --reference --spp 4", "diptych bench --scaled 1", "diptych scale"] {
            assert_eq!(translated(line), (line.to_owned(), 0));
        }
    }
}
