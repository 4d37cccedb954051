mod moves;

use super::*;
use std::path::{Path, PathBuf};

use crate::scene::Scene;
use crate::scene::budget::Budget;
use crate::scene::complete::{Overrides, complete};
use crate::scene::motion::Motion;

/// Uses every key.
const FULL: &str = r#"
name = "garage"
scene = "garage/garage.gltf"
animation = "Walk"
loop = false

[rig]
yfov_deg = 70.0
baseline_m = 0.064
metres_per_unit = 0.01

[[rig.key]]
time_s = 0.0
position = [0.0, 1.6, 2.5]
target = [0.0, 1.2, -3.0]
up = [0.0, 1.0, 0.0]

[[rig.key]]
time_s = 2
position = [0, 1.6, 1.5]
target = [0.0, 1.2, -3.0]

[environment]
radiance = [1.0, 1.0, 1.0]
scale = 1.0
rotation_deg = 0.0

[[light]]
kind = "point"
position = [0.0, 2.3, 0.0]
direction = [0.0, -1.0, 0.0]
color = [1.0, 0.5, 0.25]
intensity = 4.0
radius_m = 0.1
angle_deg = 0.0
inner_cone_deg = 20.0
outer_cone_deg = 30.0

[[light]]
kind = "directional"
direction = [0.0, -2.0, 0.0]
intensity = 3.0
angle_deg = 90e-1

[[light]]
kind = "spot"
position = [1.0, 2.0, 3.0]
direction = [0.0, 0.0, -4.0]
outer_cone_deg = 60

[[move]]
node = "Door"

[[move.key]]
rotation_deg = [0.0, 90, 0.0]
scale = [1.0, 1.0, 2.0]

[[move.key]]
time_s = 1.5
rotation_deg = [0.0, 0.0, 0.0]
scale = [1.0, 1.0, 1.0]

[[move]]
light = 1

[[move.key]]
position = [1.0, 2.0, 3.0]

[gaze]
path = [[0.0, 0.5, 0.5], [2.0, 1.0, 0.25]]

[exposure]
ev = -1.5
"#;

const MINIMAL: &str = "scene = 'builtin:box'\n[rig]\n[[rig.key]]\nposition = [0, 0, 1]\ntarget = [0, 0, 0]\n";

/// Completes a shot of an empty scene.
fn parse(text: &str, origin: &str) -> Result<Shot, SceneError> {
    complete(
        Draft::parse(text, origin)?,
        &Overrides::default(),
        &mut Scene::empty("empty"),
        &Motion::default(),
        &Budget::unlimited(),
    )
}

fn line_of(text: &str, needle: &str) -> usize {
    1 + text.lines().position(|line| line.contains(needle)).unwrap()
}

/// Asserts that `FULL` with `old` replaced fails at `old`'s line, with a message that contains each of `says`.
#[track_caller]
fn fails(old: &str, new: &str, says: &[&str]) {
    assert!(FULL.contains(old), "the test's own text lacks {old}");
    let text = FULL.replacen(old, new, 1);
    let error = parse(&text, "shots/a.toml").unwrap_err().to_string();
    let first = old.trim_start().lines().next().unwrap();
    let line = format!("line {}: ", line_of(FULL, first));
    for part in ["'shots/a.toml'", line.as_str()].iter().chain(says) {
        assert!(error.contains(part), "`{error}` lacks `{part}`");
    }
}

#[test]
fn every_key_is_read() {
    let shot = parse(FULL, "x.toml").unwrap();
    assert_eq!(shot.name, "garage");
    assert_eq!(shot.scene, SceneSource::File("garage/garage.gltf".into()));
    assert_eq!(shot.rig.keys.len(), 2);
    assert_eq!(shot.rig.metres_per_unit, 0.01);
    assert_eq!(shot.rig.yfov_rad, 70f64.to_radians());
    let environment = shot.environment.as_ref().unwrap();
    assert_eq!(environment.sky, Sky::Constant(Vec3::ONE));
    assert_eq!(shot.exposure_ev, -1.5);
    assert_eq!(shot.gaze.at(1.0), [0.75, 0.375]);
    assert_eq!(shot.gaze.at(-1.0), [0.5, 0.5]);
    assert_eq!(shot.gaze.at(9.0), [1.0, 0.25]);
}

#[test]
fn lights_are_converted_to_scene_units() {
    let lights = parse(FULL, "x.toml").unwrap().lights();
    assert_eq!(lights[0].kind, LightKind::Point { position: Vec3::new(0.0, 2.3, 0.0), radius: 10.0 });
    assert_eq!(lights[0].strength, Vec3::new(4.0, 2.0, 1.0));
    let angle_rad = 9f64.to_radians() as f32;
    assert_eq!(lights[1].kind, LightKind::Directional { direction: Vec3::NEG_Y, angle_rad });
    assert_eq!(lights[1].strength, Vec3::splat(3.0));
    let LightKind::Spot { position, radius, direction, cos_inner, cos_outer } = lights[2].kind else {
        panic!("{:?}", lights[2])
    };
    assert_eq!((position, radius, direction), (Vec3::new(1.0, 2.0, 3.0), 0.0, Vec3::NEG_Z));
    assert!((cos_outer - 0.5).abs() < 1e-6 && (cos_inner - 20f32.to_radians().cos()).abs() < 1e-6);
}

#[test]
fn omitted_keys_have_their_defaults() {
    let shot = parse(MINIMAL, "some/where/box view.toml").unwrap();
    assert_eq!(shot.name, "box view");
    assert_eq!(shot.scene, SceneSource::Builtin("box".into()));
    assert_eq!((shot.rig.baseline_m, shot.rig.metres_per_unit), (0.064, 1.0));
    assert_eq!(shot.rig.yfov_rad, 70f64.to_radians());
    assert_eq!(shot.rig.keys[0].up, glam::DVec3::Y);
    assert_eq!((shot.environment, shot.lights.len(), shot.exposure_ev), (None, 0, 0.0));
    assert_eq!(shot.gaze.at(3.0), [0.5, 0.5]);
    assert_eq!(parse(MINIMAL, "builtin:box").unwrap().name, "box");
}

#[test]
fn rejects_unknown_keys_by_line() {
    fails("scale = 1.0", "scael = 1.0", &["scael", "`scale`"]);
    fails("yfov_deg = 70.0", "fov = 70.0", &["fov", "`yfov_deg`"]);
    fails("target = [0.0, 1.2, -3.0]\nup", "upp = 1\ntarget = [0.0, 1.2, -3.0]\nup", &["upp", "`up`"]);
    fails("radius_m = 0.1", "radius = 0.1", &["radius", "`radius_m`"]);
    fails("ev = -1.5", "eV = -1.5", &["eV", "`ev`"]);
    fails("name = \"garage\"", "nane = \"garage\"", &["nane", "`name`"]);
    fails("[gaze]", "[gaze2]", &["gaze2", "`gaze`"]);
    fails("path = [[0.0, 0.5", "paths = [[0.0, 0.5", &["paths", "`path`"]);
}

#[test]
fn rejects_wrong_types_by_line() {
    fails("yfov_deg = 70.0", "yfov_deg = '70'", &["yfov_deg", "f64"]);
    fails("position = [0.0, 2.3, 0.0]", "position = [0.0, 2.3]", &["position", "length"]);
    fails("kind = \"spot\"", "kind = \"area\"", &["area", "`point`", "`directional`", "`spot`"]);
    fails("name = \"garage\"", "name = \"garage", &["string"]);
    fails("name = \"garage\"", "name =", &["value"]);
}

#[test]
fn rig_values_are_checked() {
    for bad in ["0.0", "180.0", "-5", "nan", "inf"] {
        fails("yfov_deg = 70.0", &format!("yfov_deg = {bad}"), &["rig.yfov_deg", "from 1e-6 to below 180"]);
    }
    for bad in ["0.0", "-1.0", "nan", "1e300"] {
        fails("metres_per_unit = 0.01", &format!("metres_per_unit = {bad}"), &["metres_per_unit", "above 0"]);
    }
    fails("baseline_m = 0.064", "baseline_m = -0.1", &["rig.baseline_m"]);
    fails("position = [0.0, 1.6, 2.5]", "position = [0.0, nan, 2.5]", &["rig.key[0].position", "finite"]);
    fails("up = [0.0, 1.0, 0.0]", "up = [0.0, 0.0, 0.0]", &["rig.key[0].up", "no length"]);
    fails("time_s = 2", "time_s = 0", &["rig.key[1].time_s", "after 0 s"]);
    fails("time_s = 2", "time_s = -inf", &["rig.key[1].time_s"]);
}

#[test]
fn rejects_degenerate_views_by_key() {
    fails(
        "[[rig.key]]\ntime_s = 0.0\nposition = [0.0, 1.6, 2.5]",
        "[[rig.key]]\ntime_s = 0.0\nposition = [0.0, 1.2, -3.0]",
        &["rig.key[0]", "same point"],
    );
    fails(
        "[[rig.key]]\ntime_s = 0.0\nposition = [0.0, 1.6, 2.5]",
        "[[rig.key]]\ntime_s = 0.0\nposition = [0.0, 9.0, -3.0]",
        &["rig.key[0]", "parallel"],
    );
    let across = FULL.replace("position = [0, 1.6, 1.5]", "position = [0, 0.8, -8.5]");
    let error = parse(&across, "a.toml").unwrap_err().to_string();
    assert!(error.contains("rig.key[0]: at 1 s"), "{error}");
}

#[test]
fn rejects_missing_keys_and_unknown_files() {
    let error = parse("", "a.toml").unwrap_err().to_string();
    assert!(error.contains("missing field `scene`"), "{error}");
    fails(
        "[[light]]\nkind = \"point\"\nposition = [0.0, 2.3, 0.0]\n",
        "[[light]]\nkind = \"point\"\n",
        &["light[0].position", "point light"],
    );
    let undirected = FULL.replace("direction = [0.0, -2.0, 0.0]\n", "");
    let error = parse(&undirected, "a.toml").unwrap_err().to_string();
    assert!(error.contains("light[1].direction is missing"), "{error}");
    fails("scene = \"garage/garage.gltf\"", "scene = \"garage/garage.obj\"", &["garage.obj", ".glb"]);
    fails("scene = \"garage/garage.gltf\"", "scene = \"builtin:\"", &["builtin:NAME"]);
}

#[test]
fn light_and_environment_values_are_checked() {
    fails("intensity = 4.0", "intensity = -4.0", &["light[0].intensity", "0 or a number above"]);
    fails("intensity = 3.0", "intensity = nan", &["light[1].intensity"]);
    fails("radius_m = 0.1", "radius_m = -0.1", &["light[0].radius_m"]);
    fails("color = [1.0, 0.5, 0.25]", "color = [1.0, -0.5, 0.25]", &["light[0].color"]);
    fails("direction = [0.0, -2.0, 0.0]", "direction = [0.0, 0.0, 0.0]", &["light[1].direction", "no length"]);
    fails("angle_deg = 90e-1", "angle_deg = 90", &["light[1].angle_deg"]);
    fails("inner_cone_deg = 20.0", "inner_cone_deg = 31.0", &["light[0].inner_cone_deg", "outer_cone_deg", "30"]);
    fails("outer_cone_deg = 60", "outer_cone_deg = 91", &["light[2].outer_cone_deg"]);
    fails("radiance = [1.0, 1.0, 1.0]", "radiance = [1.0, -1.0, 1.0]", &["environment.radiance"]);
    fails("radiance = [1.0, 1.0, 1.0]\nscale = 1.0", "image = 'a.png'\nscale = 1.0", &["a.png", ".hdr"]);
    fails("scale = 1.0", "scale = -1.0", &["environment.scale"]);
    fails("rotation_deg = 0.0", "rotation_deg = inf", &["environment.rotation_deg", "finite"]);
    let both = FULL.replace("scale = 1.0", "image = 'sky.hdr'");
    let error = parse(&both, "a.toml").unwrap_err().to_string();
    assert!(error.contains("both radiance and image"), "{error}");
}

#[test]
fn gaze_and_exposure_are_checked() {
    let path = "path = [[0.0, 0.5, 0.5], [2.0, 1.0, 0.25]]";
    fails(path, "path = []", &["gaze.path is empty"]);
    fails(path, "path = [[0.0, 1.5, 0.5]]", &["gaze.path[0]", "0 to 1"]);
    fails(path, "path = [[0.0, 0.5, 0.5], [0.0, 0.5, 0.5]]", &["gaze.path[1]", "after 0 s"]);
    for wrong in ["nan", "-24.1", "25", "-150", "1e30"] {
        fails("ev = -1.5", &format!("ev = {wrong}"), &["exposure.ev", "-24 to 24"]);
    }
}

#[test]
fn outer_cone_alone_can_be_narrow() {
    let narrow = FULL.replace("outer_cone_deg = 60", "outer_cone_deg = 5");
    let shot = parse(&narrow, "a.toml").unwrap();
    let ShotLightKind::Spot { inner_cone_deg, outer_cone_deg, .. } = shot.lights[2].kind else { panic!() };
    assert_eq!((inner_cone_deg, outer_cone_deg), (5.0, 5.0));
}

/// Changes bytes, and cuts, duplicates and swaps pieces, deterministically.
fn mutate(text: &str, seed: u64) -> String {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    let mut next = |below: usize| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as usize % below.max(1)
    };
    const PIECES: [&str; 12] =
        ["nan", "-inf", "1e999", "[", "]", "\"", "=", "\n", "-", "[[light]]\n", "99999999999999999999", "é"];
    let mut bytes = text.as_bytes().to_vec();
    for _ in 0..=next(4) {
        let at = next(bytes.len());
        match next(5) {
            0 => bytes[at] = next(256) as u8,
            1 => bytes.truncate(at.max(1)),
            2 => drop(bytes.splice(at..at, PIECES[next(PIECES.len())].bytes())),
            3 => drop(bytes.drain(at..(at + next(30)).min(bytes.len()))),
            _ => {
                let piece = bytes[at..(at + next(60)).min(bytes.len())].to_vec();
                let to = next(bytes.len());
                drop(bytes.splice(to..to, piece));
            }
        }
        if bytes.is_empty() {
            break;
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

#[test]
fn mutated_shots_are_finite_or_rejected_by_line() {
    let mut accepted = 0;
    for seed in 0..6000 {
        let text = mutate(FULL, seed);
        match parse(&text, "fuzz.toml") {
            Ok(shot) => {
                accepted += 1;
                for time_s in [-1.0, 0.0, 0.3, 1.0, 1.7, 5.0] {
                    let view = shot.rig.view(time_s, crate::scene::rig::Eye::RIGHT);
                    let finite = view.origin.is_finite() && view.right.is_finite() && view.up.is_finite();
                    assert!(finite && view.forward.is_finite(), "{text}");
                }
                assert!(shot.lights().iter().all(|light| light.strength.is_finite()), "{text}");
            }
            Err(error) => assert!(error.to_string().contains("line "), "{error}"),
        }
    }
    assert!(accepted > 100, "only {accepted} mutations were accepted: the test does not reach the checks");
}

/// Returns the tables of the documentation by name, each with its keys and their defaults.
fn documented() -> Vec<(String, Vec<(String, String)>)> {
    let text =
        concat!(include_str!("../../../docs/guide/shot-keys.md"), include_str!("../../../docs/guide/shot-moves.md"));
    let mut tables: Vec<(String, Vec<(String, String)>)> = Vec::new();
    for line in text.lines() {
        if let Some(heading) = line.strip_prefix("## ") {
            let name = heading.split('`').nth(1).unwrap_or_default();
            tables.push((name.trim_matches(['[', ']']).to_owned(), Vec::new()));
        } else if let Some(row) = line.strip_prefix("| `") {
            let mut cells = row.split('|').map(|cell| cell.trim().trim_matches('`').to_owned());
            let (key, default) = (cells.next().unwrap(), cells.nth(2).unwrap());
            tables.last_mut().unwrap().1.push((key, default));
        }
    }
    tables.retain(|(_, keys)| !keys.is_empty());
    tables
}

/// Returns a shot with `line` in the table of that name.
fn with_line(table: &str, line: &str) -> String {
    let heading = match table {
        "" => return format!("{line}\n{MINIMAL}"),
        "rig.key" => return MINIMAL.replace("[[rig.key]]\n", &format!("[[rig.key]]\n{line}\n")),
        "rig" => return MINIMAL.replace("[rig]\n", &format!("[rig]\n{line}\n")),
        "move" => "[[move]]\nnode = 'a'\nkey = [{ position = [0, 0, 0] }]".to_owned(),
        "move.key" => "[[move]]\nnode = 'a'\n[[move.key]]\nposition = [0, 0, 0]".to_owned(),
        "light" => "[[light]]\nkind = 'spot'\nposition = [0, 0, 0]\ndirection = [0, -1, 0]".to_owned(),
        other => format!("[{other}]"),
    };
    format!("{MINIMAL}{heading}\n{line}\n")
}

#[test]
fn documentation_lists_every_key_and_its_default() {
    let tables = documented();
    let names: Vec<&str> = tables.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["", "rig", "rig.key", "environment", "light", "exposure", "move", "move.key", "gaze"]);
    for (table, keys) in &tables {
        let error = Draft::parse(&with_line(table, "no_such_key = 0"), "x.toml").unwrap_err().to_string();
        let known = error.split_once("expected").expect("it names what is known").1;
        let known: Vec<&str> = known.split('`').skip(1).step_by(2).collect();
        let tables_in = |key: &&str| table.is_empty() && (*key == "render" || names.contains(key));
        let known: Vec<&str> = known.into_iter().filter(|key| !tables_in(key) && *key != "key").collect();
        let written: Vec<&str> = keys.iter().map(|(key, _)| key.as_str()).collect();
        assert_eq!(written, known, "[{table}]");
        let bare = parse(&with_line(table, ""), "x.toml").unwrap();
        for (key, default) in
            keys.iter().filter(|(_, default)| default.starts_with(|c: char| "[0123456789".contains(c)))
        {
            let said = parse(&with_line(table, &format!("{key} = {default}")), "x.toml");
            assert_eq!(said.unwrap(), bare, "{table}.{key} = {default}");
        }
    }
}

#[test]
fn documented_examples_are_accepted() {
    let text = concat!(include_str!("../../../docs/guide/shot.md"), include_str!("../../../docs/guide/shot-moves.md"));
    let examples: Vec<&str> = text.split("```toml\n").skip(1).map(|rest| rest.split("```").next().unwrap()).collect();
    assert!(examples.len() >= 4);
    for example in examples {
        Draft::parse(example, "shot.md").unwrap();
    }
}

#[test]
fn shots_on_disk_are_accepted() {
    let here = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/scenes");
    let folder = std::env::var_os("DIPTYCH_SCENES").map_or(here, PathBuf::from);
    let Ok(entries) = std::fs::read_dir(&folder) else {
        eprintln!("SKIPPED: no folder {}: set DIPTYCH_SCENES to check real shots", folder.display());
        return;
    };
    for path in entries.map(|entry| entry.unwrap().path()).filter(|p| p.extension().is_some_and(|e| e == "toml")) {
        let text = std::fs::read_to_string(&path).unwrap();
        let shot = parse(&text, &path.display().to_string()).unwrap();
        assert!(!shot.rig.keys.is_empty(), "{}", path.display());
    }
}
