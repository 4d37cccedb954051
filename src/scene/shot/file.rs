//! The layout of a shot file: keys, types and spans, without further validation.

use serde::Deserialize;
use toml::Spanned;

pub type Number = Spanned<f64>;
pub type Triple = Spanned<[f64; 3]>;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShotFile {
    pub name: Option<String>,
    pub scene: Spanned<String>,
    pub animation: Option<String>,
    #[serde(rename = "loop")]
    pub loops: Option<bool>,
    pub rig: Option<Spanned<RigTable>>,
    pub environment: Option<EnvironmentTable>,
    #[serde(default)]
    pub light: Vec<Spanned<LightTable>>,
    #[serde(default, rename = "move")]
    pub moves: Vec<Spanned<MoveTable>>,
    pub gaze: Option<GazeTable>,
    pub exposure: Option<ExposureTable>,
    #[serde(default)]
    pub render: serde_json::Map<String, serde_json::Value>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RigTable {
    pub yfov_deg: Option<Number>,
    pub views: Option<Number>,
    pub baseline_m: Option<Number>,
    pub convergence_m: Option<Number>,
    pub metres_per_unit: Option<Number>,
    #[serde(default)]
    pub key: Vec<Spanned<KeyTable>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KeyTable {
    pub time_s: Option<Number>,
    pub position: Triple,
    pub target: Triple,
    pub up: Option<Triple>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EnvironmentTable {
    pub radiance: Option<Triple>,
    pub image: Option<Spanned<String>>,
    pub scale: Option<Number>,
    pub rotation_deg: Option<Number>,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    Point,
    Directional,
    Spot,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LightTable {
    pub kind: Kind,
    pub position: Option<Triple>,
    pub direction: Option<Triple>,
    pub color: Option<Triple>,
    pub intensity: Option<Number>,
    pub radius_m: Option<Number>,
    pub angle_deg: Option<Number>,
    pub inner_cone_deg: Option<Number>,
    pub outer_cone_deg: Option<Number>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MoveTable {
    pub node: Option<Spanned<String>>,
    pub light: Option<Spanned<usize>>,
    #[serde(default)]
    pub key: Vec<Spanned<MoveKeyTable>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MoveKeyTable {
    pub time_s: Option<Number>,
    pub position: Option<Triple>,
    pub rotation_deg: Option<Triple>,
    pub scale: Option<Triple>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GazeTable {
    pub path: Option<Spanned<Vec<Triple>>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExposureTable {
    pub ev: Option<Number>,
    pub auto: Option<Spanned<bool>>,
}
