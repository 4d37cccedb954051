use super::*;
use crate::accel::tables::Accel;
use crate::accel::{AccelError, Layout};
use crate::scene::budget::Budget;
use crate::scene::{Scene, builtin};

fn cache(folder: &Path) -> TreeCache {
    TreeCache { least_triangles: 1, least_build: Duration::ZERO, ..TreeCache::in_folder(folder.join("trees")) }
}

fn built(scene: &Scene, cache: &TreeCache) -> Accel {
    Accel::build_within(scene, Layout::Auto, &Budget::unlimited(), cache).unwrap()
}

fn checker() -> Scene {
    (builtin::find("checker").unwrap().build)()
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<_> = fs::read_dir(folder.join("trees")).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files
}

fn assert_same(a: &Accel, b: &Accel) {
    assert!(a.nodes == b.nodes);
    assert!(cast_slice::<_, u8>(&a.triangles) == cast_slice::<_, u8>(&b.triangles));
}

#[test]
fn a_second_start_takes_the_tree_of_the_first() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, cache) = (checker(), cache(folder.path()));
    let first = built(&scene, &cache);
    assert_same(&first, &Accel::build(&scene).unwrap());
    assert_eq!(files(folder.path()).len(), 1);
    // A build that is not needed is not made.
    let flat = crate::accel::flatten::flatten(&scene, scene.instances.iter(), first.origin);
    let again = cache.tree(&flat, true, || Err(AccelError::TooLarge(0.0)));
    assert_eq!(again.unwrap().nodes.len(), first.nodes.len());
    assert_same(&first, &built(&scene, &cache));
    assert_eq!((files(folder.path()).len(), cache.take_notes().len()), (1, 0));
}

#[test]
fn other_triangles_and_other_options_have_other_trees() {
    let folder = tempfile::tempdir().unwrap();
    let (mut scene, cache) = (checker(), cache(folder.path()));
    built(&scene, &cache);
    scene.meshes[0].positions[0].x += 1e-3;
    let after = built(&scene, &cache);
    assert_same(&after, &Accel::build(&scene).unwrap());
    let flat = crate::accel::flatten::flatten(&scene, scene.instances.iter(), after.origin);
    assert!(Key::of(&flat, true) != Key::of(&flat, false));
    assert_eq!(files(folder.path()).len(), 2);
}

#[test]
fn damaged_files_are_built_again_with_a_note() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, cache) = (checker(), cache(folder.path()));
    let first = built(&scene, &cache);
    let file = files(folder.path()).remove(0);
    let whole = fs::read(&file).unwrap();
    let flipped = |at: usize| {
        let mut bytes = whole.clone();
        bytes[at] ^= 0x40;
        bytes
    };
    let longer = [&whole[..], &[0; 4]].concat();
    let cut = whole[..whole.len() / 2].to_vec();
    let (magic, nodes, last) = (flipped(0), flipped(MAGIC.len() + 23), flipped(whole.len() - 1));
    for damaged in [Vec::new(), cut, longer, magic, nodes, last, flipped(MAGIC.len() + Header::BYTES + 20)] {
        fs::write(&file, damaged).unwrap();
        assert_same(&first, &built(&scene, &cache));
        let notes = cache.take_notes();
        assert!(matches!(&notes[..], [note] if note.contains("is damaged and is built again")), "{notes:?}");
        assert!(fs::read(&file).unwrap() == whole);
    }
}

/// A file whose hash is right, since it was made so.
#[test]
fn nodes_that_do_not_exist_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, cache) = (checker(), cache(folder.path()));
    built(&scene, &cache);
    let file = files(folder.path()).remove(0);
    let flat = crate::accel::flatten::flatten(&scene, scene.instances.iter(), glam::DVec3::ZERO);
    let (key, count) = (Key::of(&flat, true), flat.len());
    let good = read(&file, key, count).unwrap();
    assert!(good.is_sound(count));
    let inner = good.nodes.iter().position(|node| node.imask != 0).unwrap();
    let with_child = |child: u32| {
        let mut bad = good.clone();
        bad.nodes[inner].child_base_idx = child;
        bad
    };
    let mut far = good.clone();
    far.order[0] = count as u32;
    let empty = Built { nodes: Vec::new(), order: Vec::new() };
    for bad in [with_child(inner as u32), with_child(good.nodes.len() as u32), with_child(u32::MAX), far, empty] {
        write(File::create(&file).unwrap(), key, &bad).unwrap();
        let error = read(&file, key, count).unwrap_err().to_string();
        assert!(error.contains("do not exist"), "{error}");
    }
}

#[test]
fn trees_used_longest_ago_go_first() {
    let folder = tempfile::tempdir().unwrap();
    let mut scene = checker();
    let wide = cache(folder.path());
    let mut made = Vec::new();
    for _ in 0..3 {
        scene.meshes[0].positions[0].x += 1e-3;
        built(&scene, &wide);
        made.extend(files(folder.path()).into_iter().filter(|file| !made.contains(file)).collect::<Vec<_>>());
    }
    for (file, age_s) in made.iter().zip([30, 50, 60]) {
        let file = File::options().write(true).open(file).unwrap();
        file.set_modified(SystemTime::now() - Duration::from_secs(age_s)).unwrap();
    }
    // A tree that is used again stays, and what a killed run has left does not.
    let bytes = fs::metadata(&made[0]).unwrap().len();
    let left = folder.path().join("trees/.a.tree.1234.part");
    let old = File::create(&left).unwrap();
    old.set_modified(SystemTime::now() - Duration::from_secs(48 * 3600)).unwrap();
    fs::write(folder.path().join("trees/notes.txt"), "mine").unwrap();
    let narrow = TreeCache { most_bytes: 3 * bytes, ..cache(folder.path()) };
    built(&scene, &wide);
    scene.meshes[0].positions[0].x += 1e-3;
    built(&scene, &narrow);
    assert!(!left.exists());
    assert!(!made[1].exists() && made[0].exists() && made[2].exists());
    assert_eq!(files(folder.path()).len(), 4);
}

#[test]
fn a_folder_that_cannot_be_written_is_noted() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("trees"), "a file").unwrap();
    let (scene, cache) = (checker(), cache(folder.path()));
    assert_same(&built(&scene, &cache), &Accel::build(&scene).unwrap());
    assert!(!cache.take_notes().is_empty());
}

#[test]
fn small_trees_and_quick_ones_are_not_kept() {
    let folder = tempfile::tempdir().unwrap();
    built(&checker(), &TreeCache { least_triangles: 1_000_000, ..cache(folder.path()) });
    built(&checker(), &TreeCache { least_build: Duration::from_secs(3600), ..cache(folder.path()) });
    assert!(!folder.path().join("trees").exists());
}
