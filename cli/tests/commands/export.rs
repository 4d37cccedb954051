//! An exported shot renders the same.

use crate::common::Folder;

#[test]
fn same_bytes_from_an_exported_shot() {
    // It has spheres, whose normals lie along no axes.
    let shot = "builtin:gallery";
    let folder = Folder::new();
    let exported = folder.run(&format!("export {shot} --out ./files")).out;
    for (shot, out) in [(exported.trim(), "exported"), (shot, "own")] {
        folder.run(&format!("render {shot} --size 48x32 --spp 2 --quiet --out ./{out}"));
    }
    folder.assert_same_eyes("exported", "own");
}
