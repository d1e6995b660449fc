//! Relaxation of the places where faces cross or fold.

use super::super::crossing::crossing_pairs;
use super::super::edges::Rings;
use super::super::mesh::TriangleMesh;
use super::super::smooth::towards_neighbors;
use super::super::statistics::folds;

/// Moves vertices of faces that cross or fold towards the mean of their neighbors, in a neighborhood that grows by one
/// ring a round, for at most some rounds. Keeps the positions with the fewest crossings, and of these those with the
/// fewest folds. Returns whether no face crosses another.
pub(super) fn relaxed(mesh: &mut TriangleMesh, rounds: usize) -> bool {
    relax(mesh, rounds, crossing_pairs)
}

/// [`relaxed`], of faces that fold alone.
pub(super) fn unfold(mesh: &mut TriangleMesh, rounds: usize) {
    relax(mesh, rounds, |_| Vec::new());
}

fn relax(
    mesh: &mut TriangleMesh,
    rounds: usize,
    crossing: impl Fn(&TriangleMesh) -> Vec<[u32; 2]>,
) -> bool {
    /// The steps of a round.
    const STEPS: usize = 4;
    let rings = Rings::new(mesh);
    let mut best = ([usize::MAX; 2], Vec::new());
    for round in 0..=rounds {
        let (crossings, folds) = (crossing(mesh), folds(mesh));
        let count = [crossings.len(), folds.len()];
        if count < best.0 {
            best = (count, mesh.positions.clone());
        }
        if count == [0, 0] || round == rounds {
            break;
        }
        let mut moves = vec![false; mesh.positions.len()];
        let mut border = Vec::new();
        let faces = crossings.into_iter().chain(folds).flatten();
        for v in faces.flat_map(|k| mesh.faces[k as usize]) {
            if !std::mem::replace(&mut moves[v as usize], true) {
                border.push(v);
            }
        }
        for _ in 0..=round {
            let mut next = Vec::new();
            for &u in border.iter().flat_map(|&v| rings.of(v)) {
                if !std::mem::replace(&mut moves[u as usize], true) {
                    next.push(u);
                }
            }
            border = next;
        }
        for _ in 0..STEPS {
            towards_neighbors(mesh, &rings, 0.5, |v| moves[v as usize]);
        }
    }
    let ([crossings, _], positions) = best;
    mesh.positions = positions;
    crossings == 0
}
