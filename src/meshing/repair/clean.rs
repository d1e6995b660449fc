//! Faces that are no faces, vertices at the same place, and faces of different orientation.

use std::collections::HashMap;

use super::super::edges::{Connectivity, by_edge, sides};
use super::super::mesh::TriangleMesh;

/// Removes faces that have the same vertex twice. If the mesh is not closed, joins vertices at the same place. Turns
/// faces so that neighbors have the same orientation, that of most of them.
pub(super) fn cleaned(mesh: &TriangleMesh) -> TriangleMesh {
    let mut mesh = proper(mesh.clone());
    if !Connectivity::of(&mesh).closed {
        mesh = proper(welded(mesh));
    }
    orient(&mut mesh);
    mesh.compacted()
}

fn proper(mut mesh: TriangleMesh) -> TriangleMesh {
    mesh.faces
        .retain(|f| f[0] != f[1] && f[1] != f[2] && f[2] != f[0]);
    mesh
}

fn welded(mut mesh: TriangleMesh) -> TriangleMesh {
    let mut first = HashMap::new();
    let place = |(v, p): (usize, &[f64; 3])| {
        // −0 and 0 are the same place.
        let key = p.map(|x| (x + 0.0).to_bits());
        *first.entry(key).or_insert(v as u32)
    };
    let places: Vec<u32> = mesh.positions.iter().enumerate().map(place).collect();
    let corners = mesh.faces.iter_mut().flatten();
    corners.for_each(|v| *v = places[*v as usize]);
    mesh
}

/// Turns faces so that those on both sides of an edge of two faces pass it in opposite directions, as far as that is
/// possible.
fn orient(mesh: &mut TriangleMesh) {
    let sides = sides(mesh);
    // Pairs of neighbors, and whether one of them has to turn.
    let mut neighbors = vec![Vec::new(); mesh.faces.len()];
    for edge in by_edge(&sides) {
        if let [a, b] = edge {
            let turned = a.forward == b.forward;
            neighbors[a.face as usize].push((b.face, turned));
            neighbors[b.face as usize].push((a.face, turned));
        }
    }
    let mut turned: Vec<Option<bool>> = vec![None; mesh.faces.len()];
    for start in 0..mesh.faces.len() {
        if turned[start].is_some() {
            continue;
        }
        turned[start] = Some(false);
        let mut part = vec![start as u32];
        let mut next = 0;
        while let Some(&k) = part.get(next) {
            next += 1;
            let own = turned[k as usize] == Some(true);
            for &(other, opposite) in &neighbors[k as usize] {
                let at = &mut turned[other as usize];
                if at.is_none() {
                    *at = Some(own != opposite);
                    part.push(other);
                }
            }
        }
        // The orientation of the larger area is right.
        let (mut kept, mut reversed) = (0.0, 0.0);
        for &k in &part {
            let area = mesh.area_vector(k).length();
            match turned[k as usize] {
                Some(true) => reversed += area,
                _ => kept += area,
            }
        }
        for &k in &part {
            if (turned[k as usize] == Some(true)) != (reversed > kept) {
                mesh.faces[k as usize].swap(1, 2);
            }
        }
    }
    if mesh.volume() < 0.0 && Connectivity::of(mesh).is_solid() {
        mesh.faces.iter_mut().for_each(|f| f.swap(1, 2));
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::samples::ball;
    use super::*;

    #[test]
    fn faces_are_turned_and_joined() {
        let mesh = ball(12);
        let mut soup = TriangleMesh::default();
        for (k, f) in mesh.faces.iter().enumerate() {
            let first = soup.positions.len() as u32;
            soup.positions.extend(f.map(|v| mesh.positions[v as usize]));
            let turned = k % 3 == 0;
            soup.faces
                .push([0, 1 + u32::from(turned), 2 - u32::from(turned)].map(|v| first + v));
        }
        soup.faces.push([0, 0, 1]);
        let clean = cleaned(&soup);
        let found = clean.statistics().expect("a mesh");
        assert!(found.is_solid() && found.genus == Some(0), "{found:?}");
        assert_eq!(clean.faces.len(), mesh.faces.len());
        assert!((clean.volume() - mesh.volume()).abs() < 1e-9);
        let mut inside_out = mesh.clone();
        inside_out.faces.iter_mut().for_each(|f| f.swap(0, 1));
        assert!((cleaned(&inside_out).volume() - mesh.volume()).abs() < 1e-9);
    }
}
