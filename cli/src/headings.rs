//! Headings of the sections in a command's help.

pub const SCENE: &str = "What to render";
pub const QUALITY: &str = "Quality";
pub const DEVICES: &str = "Devices";
pub const OUTPUT: &str = "Output";
pub const TESTS: &str = "For tests";
