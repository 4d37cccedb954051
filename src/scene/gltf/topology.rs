//! Topology: assembles a primitive's corners into triangles, and drops the vertices that no triangle uses.

use ::gltf::json::mesh::Mode;

use super::accessor::Elements;
use super::fault::{Fault, Outcome};

/// Returns the vertex index of each corner, all below `vertex_count`.
pub fn corners(indices: Option<(Elements, usize)>, vertex_count: usize) -> Outcome<Vec<u32>> {
    let Some((indices, accessor)) = indices else { return Ok((0..vertex_count as u32).collect()) };
    let corners: Vec<u32> = (0..indices.count).map(|i| indices.unsigned(i)).collect();
    match corners.iter().position(|&v| v as usize >= vertex_count) {
        None => Ok(corners),
        Some(at) => Err(Fault::Invalid(format!(
            "indices: accessor {accessor} points to vertex {} (its element {at}), but there are {vertex_count}",
            corners[at]
        ))),
    }
}

/// Assembles triangles from corners, in the order of section 3.7.2.1 of glTF 2.0. Degenerate triangles of strips and
/// fans, which jump to another part of the mesh, are dropped, and so are corners after the last whole triangle.
pub fn assemble(mode: Mode, corners: &[u32]) -> Vec<[u32; 3]> {
    let has_area = |t: &[u32; 3]| t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
    match mode {
        Mode::TriangleStrip => {
            let turned = |(i, w): (usize, &[u32])| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[0], w[2], w[1]] };
            corners.windows(3).enumerate().map(turned).filter(has_area).collect()
        }
        Mode::TriangleFan => {
            let hub = corners.first().copied().unwrap_or_default();
            let rim = corners.get(1..).unwrap_or_default();
            rim.windows(2).map(|w| [w[0], w[1], hub]).filter(has_area).collect()
        }
        _ => corners.as_chunks::<3>().0.to_vec(),
    }
}

/// Renumbers the triangles' vertices without gaps. Returns their old indices in increasing order.
pub fn compact(triangles: &mut [[u32; 3]], vertex_count: usize) -> Vec<u32> {
    // The new index of each vertex plus one, or 0 if it is unused. Since the array is allocated zeroed, pages that no
    // triangle touches take no physical memory.
    let mut successor = vec![0u32; vertex_count];
    let mut used = Vec::new();
    for &v in triangles.as_flattened() {
        if std::mem::replace(&mut successor[v as usize], 1) == 0 {
            used.push(v);
        }
    }
    used.sort_unstable();
    for (new, &old) in used.iter().enumerate() {
        successor[old as usize] = new as u32 + 1;
    }
    for v in triangles.as_flattened_mut() {
        *v = successor[*v as usize] - 1;
    }
    used
}
