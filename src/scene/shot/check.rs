//! Validation of shot files: turns the file's tables into a [`Draft`] or an error with line and key.

use std::ops::Range;
use std::path::Path;

use glam::{DVec3, Vec3};
use toml::Spanned;

use super::allowed::{ANY, Allowed, CONE, DISC, FRACTION, NOT_NEGATIVE, POSITIVE, STOPS, VIEWS, YFOV, fits_f32};
use super::file::{
    EnvironmentTable, ExposureTable, KeyTable, Kind, LightTable, MoveKeyTable, MoveTable, Number, RigTable, ShotFile,
    Triple,
};
use super::{Draft, Exposure, Gaze, PartialRig, SceneSource, ShotEnvironment, ShotLight, ShotLightKind, Sky};
use crate::scene::SceneError;
use crate::scene::motion::play::{Choice, Move, MoveKey, Moved};
use crate::scene::rig::{self, RigKey};

const DEFAULT_INNER_CONE_DEG: f64 = 20.0;
const DEFAULT_OUTER_CONE_DEG: f64 = 30.0;

type Result<T> = std::result::Result<T, SceneError>;

pub fn draft(text: &str, origin: &str) -> Result<Draft> {
    let check = Check { text, origin };
    let file: ShotFile = toml::from_str(text).map_err(|error| check.syntax(error))?;
    let rig = file.rig.as_ref().map_or(Ok(PartialRig::default()), |table| check.rig(table))?;
    let lights = file.light.iter().enumerate();
    let moves = check.moves(&file.moves, file.light.len())?;
    Ok(Draft {
        name: file.name.unwrap_or_else(|| stem(origin)),
        scene: check.scene(&file.scene)?,
        animation: file.animation.as_deref().map(Choice::of),
        loops: file.loops,
        moves,
        environment: file.environment.map(|table| check.environment(&table)).transpose()?,
        lights: lights.map(|(i, table)| check.light(i, table, &rig)).collect::<Result<_>>()?,
        gaze: file.gaze.and_then(|table| table.path).map(|path| check.gaze(&path)).transpose()?,
        exposure: file.exposure.map_or(Ok(None), |table| check.exposure(&table))?,
        settings: file.render,
        rig,
    })
}

fn stem(origin: &str) -> String {
    let origin = origin.strip_prefix("builtin:").unwrap_or(origin);
    Path::new(origin).file_stem().map_or_else(|| origin.to_owned(), |stem| stem.to_string_lossy().into_owned())
}

struct Check<'a> {
    text: &'a str,
    origin: &'a str,
}

impl Check<'_> {
    fn at(&self, span: Range<usize>, what: String) -> SceneError {
        let before = &self.text.as_bytes()[..span.start.min(self.text.len())];
        let line = 1 + before.iter().filter(|&&byte| byte == b'\n').count();
        SceneError::Invalid { path: self.origin.to_owned(), what: format!("line {line}: {what}") }
    }

    /// Converts an error of the toml crate to a [`SceneError`] that names the key. The crate names the key only in the
    /// text that it prints if it has no source to quote, so the key is extracted from that text.
    fn syntax(&self, mut error: toml::de::Error) -> SceneError {
        let message = error.message().trim().replace('\n', ", ");
        let span = error.span().unwrap_or(0..0);
        error.set_input(None);
        let printed = error.to_string();
        let key = printed.lines().find_map(|line| line.strip_prefix("in `")?.strip_suffix('`'));
        self.at(span, key.map_or(message.clone(), |key| format!("{key}: {message}")))
    }

    fn number(&self, key: &str, value: &Number, allowed: &Allowed) -> Result<f64> {
        let v = *value.get_ref();
        match allowed.allows(v) {
            true => Ok(v),
            false => Err(self.at(value.span(), format!("{key} is {v}: give {}", allowed.what))),
        }
    }

    fn optional(&self, key: &str, value: Option<&Number>, allowed: &Allowed) -> Result<Option<f64>> {
        value.map(|value| self.number(key, value, allowed)).transpose()
    }

    fn number_or(&self, key: &str, value: Option<&Number>, default: f64, allowed: &Allowed) -> Result<f64> {
        Ok(self.optional(key, value, allowed)?.unwrap_or(default))
    }

    fn triple(&self, key: &str, value: &Triple, allowed: &Allowed) -> Result<DVec3> {
        let v = *value.get_ref();
        match v.iter().all(|&c| allowed.allows(c)) {
            true => Ok(v.into()),
            false => Err(self.at(value.span(), format!("{key} is {v:?}: give each {}", allowed.what))),
        }
    }

    fn unit(&self, key: &str, value: &Triple) -> Result<DVec3> {
        let v = self.triple(key, value, &ANY)?;
        v.try_normalize().ok_or_else(|| self.at(value.span(), format!("{key} has no length: give a direction")))
    }

    fn scene(&self, value: &Spanned<String>) -> Result<SceneSource> {
        let text = value.get_ref();
        match text.strip_prefix("builtin:") {
            Some("") => Err(self.at(value.span(), "scene names no built-in scene: give \"builtin:NAME\"".into())),
            Some(name) => Ok(SceneSource::Builtin(name.to_owned())),
            None if has_extension(text, &["gltf", "glb"]) => Ok(SceneSource::File(text.into())),
            None => Err(self.at(value.span(), format!("scene is '{text}': give a .gltf, a .glb or \"builtin:NAME\""))),
        }
    }

    fn rig(&self, table: &Spanned<RigTable>) -> Result<PartialRig> {
        let t = table.get_ref();
        let rig = PartialRig {
            yfov_rad: self.optional("rig.yfov_deg", t.yfov_deg.as_ref(), &YFOV)?.map(f64::to_radians),
            views: self.optional("rig.views", t.views.as_ref(), &VIEWS)?.map(|views| views as usize),
            convergence_m: self.optional("rig.convergence_m", t.convergence_m.as_ref(), &POSITIVE)?,
            baseline_m: self.optional("rig.baseline_m", t.baseline_m.as_ref(), &NOT_NEGATIVE)?,
            metres_per_unit: self.optional("rig.metres_per_unit", t.metres_per_unit.as_ref(), &POSITIVE)?,
            keys: self.keys(&t.key)?,
        };
        let baseline_m = rig.baseline_m.unwrap_or(rig::DEFAULT_BASELINE_M);
        if !fits_f32(baseline_m / rig.metres_per_unit.unwrap_or(1.0)) {
            let what = "rig.baseline_m / rig.metres_per_unit is too large a number: give other units";
            return Err(self.at(table.span(), what.into()));
        }
        match rig::degenerate_time(&rig.keys) {
            None => Ok(rig),
            Some(time_s) => {
                // The message names the last key at or before that time. The first key is never later than that time.
                let before = rig.keys.iter().rposition(|key| key.time_s <= time_s).unwrap_or(0);
                let what = format!(
                    "rig.key[{before}]: at {time_s} s position and target are the same point, or up is parallel \
                     to the view: give a target away from the position, in another direction than up"
                );
                Err(self.at(t.key[before].span(), what))
            }
        }
    }

    fn keys(&self, tables: &[Spanned<KeyTable>]) -> Result<Vec<RigKey>> {
        let mut keys: Vec<RigKey> = Vec::with_capacity(tables.len());
        for (i, table) in tables.iter().enumerate() {
            let (t, name) = (table.get_ref(), |field: &str| format!("rig.key[{i}].{field}"));
            let time_s = self.number_or(&name("time_s"), t.time_s.as_ref(), 0.0, &ANY)?;
            if let Some(last) = keys.last().filter(|last| last.time_s >= time_s) {
                let span = t.time_s.as_ref().map_or(table.span(), Spanned::span);
                let what = format!("{} is {time_s}: give a time after {} s", name("time_s"), last.time_s);
                return Err(self.at(span, what));
            }
            keys.push(RigKey {
                time_s,
                position: self.triple(&name("position"), &t.position, &ANY)?,
                target: self.triple(&name("target"), &t.target, &ANY)?,
                up: t.up.as_ref().map_or(Ok(DVec3::Y), |up| self.unit(&name("up"), up))?,
            });
        }
        Ok(keys)
    }

    fn environment(&self, t: &EnvironmentTable) -> Result<ShotEnvironment> {
        let sky = match (&t.radiance, &t.image) {
            (Some(_), Some(image)) => {
                let what = "environment has both radiance and image: give one of them";
                return Err(self.at(image.span(), what.into()));
            }
            (None, Some(image)) if has_extension(image.get_ref(), &["hdr", "exr"]) => {
                Sky::Image(image.get_ref().into())
            }
            (None, Some(image)) => match Sky::built_in(image.get_ref()) {
                Some(sky) => sky,
                None => {
                    let what = format!("environment.image is '{}': give a .hdr or an .exr", image.get_ref());
                    return Err(self.at(image.span(), what));
                }
            },
            (Some(v), None) => Sky::Constant(self.triple("environment.radiance", v, &NOT_NEGATIVE)?.as_vec3()),
            (None, None) => Sky::Constant(Vec3::ONE),
        };
        let scale = self.number_or("environment.scale", t.scale.as_ref(), 1.0, &NOT_NEGATIVE)? as f32;
        if let (Sky::Constant(radiance), Some(span)) = (&sky, t.scale.as_ref().map(Spanned::span))
            && !(*radiance * scale).is_finite()
        {
            return Err(self.at(span, "environment.radiance × scale is too large a number: give less".into()));
        }
        let rotation_deg = self.number_or("environment.rotation_deg", t.rotation_deg.as_ref(), 0.0, &ANY)? as f32;
        Ok(ShotEnvironment { sky, scale, rotation_deg })
    }

    fn exposure(&self, t: &ExposureTable) -> Result<Option<Exposure>> {
        let ev = self.optional("exposure.ev", t.ev.as_ref(), &STOPS)?.map(|ev| Exposure::Ev(ev as f32));
        let Some(auto) = t.auto.as_ref().filter(|auto| *auto.get_ref()) else { return Ok(ev) };
        match ev {
            Some(_) => Err(self.at(auto.span(), "exposure has both ev and auto: give one of them".into())),
            None => Ok(Some(Exposure::Auto)),
        }
    }

    /// Reads a light. Keys that its kind does not use are validated, then ignored.
    fn light(&self, index: usize, table: &Spanned<LightTable>, rig: &PartialRig) -> Result<ShotLight> {
        let (t, name) = (table.get_ref(), |field: &str| format!("light[{index}].{field}"));
        let missing = |field: &str, kind: &str| {
            self.at(table.span(), format!("{} is missing: a {kind} light needs it", name(field)))
        };
        let position = t.position.as_ref().map(|v| self.triple(&name("position"), v, &ANY)).transpose()?;
        let position = position.map(|v| v.as_vec3());
        let direction = t.direction.as_ref().map(|v| self.unit(&name("direction"), v)).transpose()?;
        let direction = direction.map(|v| v.as_vec3());
        let radius_m = self.number_or(&name("radius_m"), t.radius_m.as_ref(), 0.0, &NOT_NEGATIVE)?;
        if !fits_f32(radius_m / rig.metres_per_unit.unwrap_or(1.0)) {
            let what = format!("{} / rig.metres_per_unit is too large a number: give less", name("radius_m"));
            return Err(self.at(table.span(), what));
        }
        let angle_deg = self.number_or(&name("angle_deg"), t.angle_deg.as_ref(), 0.0, &DISC)?;
        let (inner_cone_deg, outer_cone_deg) = self.cones(t, name)?;
        let kind = match t.kind {
            Kind::Point => {
                ShotLightKind::Point { position: position.ok_or_else(|| missing("position", "point"))?, radius_m }
            }
            Kind::Directional => ShotLightKind::Directional {
                direction: direction.ok_or_else(|| missing("direction", "directional"))?,
                angle_deg,
            },
            Kind::Spot => ShotLightKind::Spot {
                position: position.ok_or_else(|| missing("position", "spot"))?,
                direction: direction.ok_or_else(|| missing("direction", "spot"))?,
                radius_m,
                inner_cone_deg,
                outer_cone_deg,
            },
        };
        let color = t.color.as_ref().map_or(Ok(DVec3::ONE), |v| self.triple(&name("color"), v, &NOT_NEGATIVE))?;
        let intensity = self.number_or(&name("intensity"), t.intensity.as_ref(), 1.0, &NOT_NEGATIVE)?;
        let strength = (color * intensity).as_vec3();
        match strength.is_finite() {
            true => Ok(ShotLight { kind, strength }),
            false => {
                let what = format!("{} × color is too large a number: give less", name("intensity"));
                Err(self.at(t.intensity.as_ref().map_or(table.span(), Spanned::span), what))
            }
        }
    }

    /// Returns the inner and outer half-angles of a spot's cone in degrees. If only the outer cone is given and is
    /// narrower than the default inner one, the inner one shrinks to it.
    fn cones(&self, t: &LightTable, name: impl Fn(&str) -> String) -> Result<(f64, f64)> {
        let outer_default = DEFAULT_OUTER_CONE_DEG;
        let outer = self.number_or(&name("outer_cone_deg"), t.outer_cone_deg.as_ref(), outer_default, &CONE)?;
        let Some(inner) = &t.inner_cone_deg else {
            return Ok((DEFAULT_INNER_CONE_DEG.min(outer), outer));
        };
        let inner_deg = self.number(&name("inner_cone_deg"), inner, &CONE)?;
        match inner_deg <= outer {
            true => Ok((inner_deg, outer)),
            false => {
                let what =
                    format!("{} is {inner_deg}: give at most outer_cone_deg, which is {outer}", name("inner_cone_deg"));
                Err(self.at(inner.span(), what))
            }
        }
    }

    fn moves(&self, tables: &[Spanned<MoveTable>], lights: usize) -> Result<Vec<Move>> {
        let mut moves: Vec<Move> = Vec::with_capacity(tables.len());
        for (i, table) in tables.iter().enumerate() {
            let t = table.get_ref();
            let of = match (&t.node, &t.light) {
                (Some(node), None) => Moved::Node(node.get_ref().clone()),
                (None, Some(light)) if *light.get_ref() < lights => Moved::Light(*light.get_ref()),
                (None, Some(light)) => {
                    let what = format!("move[{i}].light is {}: the file has {lights} [[light]]", light.get_ref());
                    return Err(self.at(light.span(), what));
                }
                _ => return Err(self.at(table.span(), format!("move[{i}]: give either a node or a light"))),
            };
            if moves.iter().any(|other| other.of == of) {
                return Err(self.at(table.span(), format!("move[{i}] has the target of another [[move]]: give one")));
            }
            moves.push(Move { of, keys: self.move_keys(i, table)? });
        }
        Ok(moves)
    }

    fn move_keys(&self, index: usize, table: &Spanned<MoveTable>) -> Result<Vec<MoveKey>> {
        let mut keys: Vec<MoveKey> = Vec::new();
        for (i, table) in table.get_ref().key.iter().enumerate() {
            let t: &MoveKeyTable = table.get_ref();
            let name = |field: &str| format!("move[{index}].key[{i}].{field}");
            let triple = |field: &str, value: &Option<Triple>| {
                value.as_ref().map(|v| self.triple(&name(field), v, &ANY)).transpose()
            };
            let key = MoveKey {
                time_s: self.number_or(&name("time_s"), t.time_s.as_ref(), 0.0, &NOT_NEGATIVE)?,
                position: triple("position", &t.position)?,
                rotation_deg: triple("rotation_deg", &t.rotation_deg)?,
                scale: triple("scale", &t.scale)?,
            };
            // Move keys are stored like glTF's, with f32 times.
            if let Some(last) = keys.last().filter(|last| last.time_s as f32 >= key.time_s as f32) {
                let what = format!("{} is {}: give a time after {} s", name("time_s"), key.time_s, last.time_s);
                return Err(self.at(t.time_s.as_ref().map_or(table.span(), Spanned::span), what));
            }
            let given = |key: &MoveKey| [key.position.is_some(), key.rotation_deg.is_some(), key.scale.is_some()];
            if keys.first().is_some_and(|first| given(first) != given(&key)) || given(&key) == [false; 3] {
                let what =
                    format!("move[{index}].key[{i}]: give position, rotation_deg or scale, the same in all keys");
                return Err(self.at(table.span(), what));
            }
            keys.push(key);
        }
        match keys.is_empty() {
            true => Err(self.at(table.span(), format!("move[{index}] has no [[move.key]]: give at least one"))),
            false => Ok(keys),
        }
    }

    fn gaze(&self, points: &Spanned<Vec<Triple>>) -> Result<Gaze> {
        let mut path: Vec<[f64; 3]> = Vec::new();
        for (i, point) in points.get_ref().iter().enumerate() {
            let name = format!("gaze.path[{i}]");
            let [time_s, x, y] = self.triple(&name, point, &ANY)?.to_array();
            if !FRACTION.allows(x) || !FRACTION.allows(y) {
                let what = format!("{name} looks at ({x}, {y}): give x and y each {}", FRACTION.what);
                return Err(self.at(point.span(), what));
            }
            if let Some([last, ..]) = path.last().filter(|last| last[0] >= time_s) {
                return Err(self.at(point.span(), format!("{name} is at {time_s} s: give a time after {last} s")));
            }
            path.push([time_s, x, y]);
        }
        match path.is_empty() {
            true => Err(self.at(points.span(), "gaze.path is empty: give at least one [time_s, x, y]".into())),
            false => Ok(Gaze { path }),
        }
    }
}

fn has_extension(path: &str, allowed: &[&str]) -> bool {
    let extension = Path::new(path).extension().and_then(|e| e.to_str());
    extension.is_some_and(|e| allowed.iter().any(|a| a.eq_ignore_ascii_case(e)))
}
