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
    builtin::find("checker").unwrap().build()
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
fn second_start_reuses_the_cached_tree() {
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
fn cache_key_depends_on_triangles_and_options() {
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
    for damaged in [Vec::new(), cut, longer, magic, nodes, last, flipped(size_of::<Header>() + 20)] {
        fs::write(&file, damaged).unwrap();
        assert_same(&first, &built(&scene, &cache));
        let notes = cache.take_notes();
        assert!(matches!(&notes[..], [note] if note.contains("is damaged and is built again")), "{notes:?}");
        assert!(fs::read(&file).unwrap() == whole);
    }
}

/// A file whose hash is right, since it was made so.
#[test]
fn rejects_cached_trees_with_missing_nodes() {
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
    let empty = Built { nodes: Vec::new(), order: good.order.clone() };
    for bad in [with_child(inner as u32), with_child(good.nodes.len() as u32), with_child(u32::MAX), far, empty] {
        write(File::create(&file).unwrap(), key, &bad).unwrap();
        let error = read(&file, key, count).unwrap_err().to_string();
        assert!(error.contains("do not exist"), "{error}");
    }
}

#[test]
fn rejects_cached_trees_with_other_node_counts() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, cache) = (checker(), cache(folder.path()));
    let first = built(&scene, &cache);
    let path = files(folder.path()).remove(0);
    let flat = crate::accel::flatten::flatten(&scene, scene.instances.iter(), first.origin);
    let (key, triangles) = (Key::of(&flat, true), flat.len() as u64);
    for (nodes, indices) in [(1 << 29, 1), (1 << 29, triangles), (1, 10 << 30), (1, triangles - 1), (1, u64::MAX)] {
        let file = File::create(&path).unwrap();
        let header = Header { magic: MAGIC, key, nodes, indices, content: 0 };
        (&file).write_all(bytes_of(&header)).unwrap();
        // A sparse file: it takes a few kilobytes of the disk.
        let length = u128::from(nodes) * size_of::<CwBvhNode>() as u128 + u128::from(indices) * 4;
        let _ = file.set_len(length.min(1 << 40) as u64 + size_of::<Header>() as u64);
        let error = read(&path, key, flat.len()).unwrap_err().to_string();
        assert!(error.contains("another number of nodes"), "{error}");
    }
}

/// A folder stands for a file that cannot be read, since permissions do not bind the superuser.
#[test]
fn unreadable_cache_file_is_kept_and_noted() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, cache) = (checker(), cache(folder.path()));
    let first = built(&scene, &cache);
    let path = files(folder.path()).remove(0);
    fs::remove_file(&path).unwrap();
    fs::create_dir(&path).unwrap();
    assert_same(&first, &built(&scene, &cache));
    let notes = cache.take_notes();
    assert!(matches!(&notes[..], [note] if note.contains("cannot be read")), "{notes:?}");
    assert!(path.is_dir());
}

#[test]
fn cache_key_names_the_version_of_obvhs() {
    let lock = fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/Cargo.lock")).unwrap();
    let version = BUILDERS.split(' ').next_back().unwrap();
    assert!(lock.contains(&format!("name = \"obvhs\"\nversion = \"{version}\"\n")), "{BUILDERS}");
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
    let old = |name: &str| {
        let path = folder.path().join("trees").join(name);
        let file = File::create(&path).unwrap();
        file.set_modified(SystemTime::now() - Duration::from_secs(48 * 3600)).unwrap();
        path
    };
    let name = made[0].file_name().unwrap().to_str().unwrap();
    let left = old(&format!(".{name}x1Y2z3.part"));
    let upper = name.to_uppercase().replace(".TREE", ".tree");
    let of_user = ["notes.txt", "film.mkv.part", ".film.part", "oak.tree", "0.tree", &upper, &format!("{name}.part")];
    let of_user = of_user.map(old);
    let narrow = TreeCache { most_bytes: 3 * bytes, ..cache(folder.path()) };
    built(&scene, &wide);
    scene.meshes[0].positions[0].x += 1e-3;
    built(&scene, &narrow);
    assert!(!left.exists());
    assert!(!made[1].exists() && made[0].exists() && made[2].exists());
    assert!(of_user.iter().all(|path| path.exists()), "files of other names are the user's");
    assert_eq!(files(folder.path()).len(), 3 + of_user.len());
}

#[test]
fn unwritable_cache_folder_is_noted() {
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
