//! Checks the JSON schema of `run.json` in `docs/` against the types that are serialized to that file.

use schemars::generate::SchemaSettings;
use serde_json::json;

use super::run::RunReport;

/// Environment variable that makes the test write the schema file before it compares.
const WRITES: &str = "DIPTYCH_WRITE_SCHEMA";

#[test]
fn schema_in_docs_equals_the_types() {
    let generator = SchemaSettings::draft2020_12().for_serialize().into_generator();
    let mut schema = generator.into_root_schema_for::<RunReport>();
    schema.insert("title".into(), json!("run.json of diptych"));
    // Remove rustdoc links.
    let text = serde_json::to_string_pretty(&schema).unwrap().replace("[`", "`").replace("`]", "`") + "\n";
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/run.schema.json");
    if std::env::var_os(WRITES).is_some() {
        std::fs::write(path, &text).unwrap();
    }
    let committed = std::fs::read_to_string(path).unwrap_or_default();
    assert!(committed == text, "docs/run.schema.json is out of date: run this test with {WRITES}=1");
}
