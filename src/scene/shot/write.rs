//! Writer of shots as editable files.

use std::fmt::Write;

use serde_json::json;
use toml::Value;

use super::{SceneSource, Shot, ShotEnvironment, ShotLight, ShotLightKind, Sky};
use crate::scene::motion::play::{Move, Moved, Play};
use crate::scene::rig::Rig;

/// Returns the text of the file.
pub fn text(shot: &Shot) -> String {
    let source = match &shot.scene {
        SceneSource::File(name) => name.clone(),
        SceneSource::Builtin(name) => format!("builtin:{name}"),
    };
    let mut text = format!(
        "name = {}\n# Path relative to this file, or \"builtin:NAME\".\nscene = {}\n",
        string(&shot.name),
        string(&source)
    );
    play(&mut text, &shot.play);
    rig(&mut text, shot);
    environment(&mut text, shot.environment.as_ref());
    text += "\n# Lights in addition to those of the scene file. point and spot have a position, and are spheres if\n\
        # radius_m is above 0; directional and spot have the direction in which their light travels. intensity times\n\
        # color is in W/sr, for directional in W/m2.\n";
    for each in &shot.lights {
        light(&mut text, each);
    }
    if shot.lights.is_empty() {
        text += "# [[light]]\n# kind = \"point\"\n# position = [0.0, 2.0, 0.0]\n# intensity = 5.0\n# radius_m = 0.05\n";
    }
    moves(&mut text, &shot.play.moves);
    let path: Vec<String> = shot.gaze.path.iter().map(|point| numbers(point)).collect();
    let exposure = if shot.is_metered { "auto = true".to_owned() } else { format!("ev = {:?}", shot.exposure_ev) };
    let _ = write!(
        text,
        "\n# Gaze in each eye's image over time: [time_s, x, y], x and y from 0 to 1 from the top left.\n[gaze]\n\
         path = [{}]\n\n# Exposure of pictures in stops; EXR files are not changed.\n[exposure]\n{exposure}\n",
        path.join(", ")
    );
    // Only invalid settings cannot be written.
    let settings = (!shot.settings.is_empty()).then(|| toml::to_string(&json!({ "render": shot.settings })).ok());
    text + &settings.flatten().map_or(String::new(), |render| format!("\n# Settings of picture and quality.\n{render}"))
}

fn play(text: &mut String, play: &Play) {
    let _ = write!(
        text,
        "# Animations of the scene file: \"all\", \"none\" or a name. If loop is false, they stop at their end.\n\
         animation = {}\nloop = {}\n",
        string(play.animation.text()),
        play.loops
    );
}

fn moves(text: &mut String, moves: &[Move]) {
    *text += "\n# Moves a node of the scene or a light of this file: position, rotation_deg or scale in the parent.\n";
    for one in moves {
        let _ = match &one.of {
            Moved::Node(name) => writeln!(text, "[[move]]\nnode = {}", string(name)),
            Moved::Light(number) => writeln!(text, "[[move]]\nlight = {number}"),
        };
        for key in &one.keys {
            let _ = writeln!(text, "[[move.key]]\ntime_s = {:?}", key.time_s);
            for (name, value) in [("position", key.position), ("rotation_deg", key.rotation_deg), ("scale", key.scale)]
            {
                if let Some(value) = value {
                    let _ = writeln!(text, "{name} = {}", numbers(&value.to_array()));
                }
            }
        }
    }
    if moves.is_empty() {
        *text += "# [[move]]\n# node = \"Door\"\n# [[move.key]]\n# time_s = 0.0\n# rotation_deg = [0.0, 90.0, 0.0]\n";
    }
}

fn rig(text: &mut String, shot: &Shot) {
    let rig = &shot.rig;
    // Rounds degrees, so that 70 degrees converted to radians and back print as 70.
    let yfov_deg = (rig.yfov_rad.to_degrees() * 1e12).round() / 1e12;
    let _ = write!(
        text,
        "\n[rig]\n# Vertical field of view of each eye.\nyfov_deg = {yfov_deg:?}\n# Distance between the eyes; 0 gives \
         both the same view.\nbaseline_m = {:?}\n{}# Scale of the scene.\nmetres_per_unit = {:?}\n\n# The point between \
         the eyes, in scene units. Several keys make a path, linear between them.\n",
        rig.baseline_m,
        views(rig),
        rig.metres_per_unit
    );
    for key in &rig.keys {
        let [position, target, up] = [key.position, key.target, key.up].map(|v| numbers(&v.to_array()));
        let time_s = key.time_s;
        let _ = write!(text, "[[rig.key]]\ntime_s = {time_s:?}\nposition = {position}\ntarget = {target}\nup = {up}\n");
    }
}

/// Returns the lines about the views that differ from the default.
fn views(rig: &Rig) -> String {
    let count = if rig.views == 2 {
        String::new()
    } else {
        format!("# Number of views, side by side.\nviews = {}\n", rig.views)
    };
    let converge =
        |distance_m| format!("# Distance at which all views show the same.\nconvergence_m = {distance_m:?}\n");
    count + &rig.convergence_m.map_or_else(String::new, converge)
}

fn environment(text: &mut String, environment: Option<&ShotEnvironment>) {
    *text += "\n# Environment light: radiance, or image = \"sky.hdr\" (or .exr), a latitude-longitude image.\n";
    let Some(ShotEnvironment { sky, scale, rotation_deg }) = environment else {
        *text += "# [environment]\n# radiance = [1.0, 1.0, 1.0]\n";
        return;
    };
    let sky = match sky {
        Sky::Constant(radiance) => format!("radiance = {}", numbers(&radiance.to_array())),
        Sky::Image(name) => format!("image = {}", string(name)),
        Sky::Studio => "image = \"studio\"".to_owned(),
        Sky::Clear => "image = \"sky\"".to_owned(),
    };
    let _ = writeln!(text, "[environment]\n{sky}\nscale = {scale:?}\nrotation_deg = {rotation_deg:?}");
}

fn light(text: &mut String, light: &ShotLight) {
    let mut lines = Vec::new();
    let mut line = |key: &str, value: String| lines.push(format!("{key} = {value}\n"));
    match light.kind {
        ShotLightKind::Point { position, radius_m } => {
            line("kind", string("point"));
            line("position", numbers(&position.to_array()));
            line("radius_m", format!("{radius_m:?}"));
        }
        ShotLightKind::Directional { direction, angle_deg } => {
            line("kind", string("directional"));
            line("direction", numbers(&direction.to_array()));
            line("angle_deg", format!("{angle_deg:?}"));
        }
        ShotLightKind::Spot { position, radius_m, direction, inner_cone_deg, outer_cone_deg } => {
            line("kind", string("spot"));
            line("position", numbers(&position.to_array()));
            line("radius_m", format!("{radius_m:?}"));
            line("direction", numbers(&direction.to_array()));
            line("inner_cone_deg", format!("{inner_cone_deg:?}"));
            line("outer_cone_deg", format!("{outer_cone_deg:?}"));
        }
    }
    line("color", numbers(&light.strength.to_array()));
    line("intensity", "1.0".to_owned());
    *text += "[[light]]\n";
    text.extend(lines);
}

fn string(text: &str) -> String {
    Value::String(text.to_owned()).to_string()
}

fn numbers<T: std::fmt::Debug>(values: &[T]) -> String {
    format!("{values:?}")
}
