//! Texture coordinates of low distortion, by local and global steps.

use glam::DVec2;

use super::overlap::{border, turned};

/// Steps over all triangles and vertices.
const ROUNDS: usize = 10;
/// How often vertices of triangles that turned over move.
const UNTANGLED: usize = 60;

/// The entries of a symmetric matrix: for each row its diagonal, and the columns and values of the others.
struct Matrix {
    starts: Vec<usize>,
    columns: Vec<u32>,
    values: Vec<f64>,
    diagonal: Vec<f64>,
}

impl Matrix {
    /// The Laplacian of edges with weights.
    fn laplacian(vertices: usize, mut edges: Vec<(u32, u32, f64)>) -> Self {
        edges.extend_from_within(..);
        let half = edges.len() / 2;
        edges[half..].iter_mut().for_each(|e| *e = (e.1, e.0, e.2));
        edges.sort_unstable_by_key(|e| (e.0, e.1));
        let mut matrix = Self {
            starts: vec![0; vertices + 1],
            columns: Vec::new(),
            values: Vec::new(),
            diagonal: vec![0.0; vertices],
        };
        for group in edges.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            let weight: f64 = group.iter().map(|e| e.2).sum();
            matrix.columns.push(group[0].1);
            matrix.values.push(-weight);
            matrix.starts[group[0].0 as usize + 1] += 1;
            matrix.diagonal[group[0].0 as usize] += weight;
        }
        for i in 0..vertices {
            matrix.starts[i + 1] += matrix.starts[i];
        }
        matrix
    }

    fn times(&self, x: &[DVec2], result: &mut [DVec2]) {
        for (i, out) in result.iter_mut().enumerate() {
            let mut sum = x[i] * self.diagonal[i];
            for k in self.starts[i]..self.starts[i + 1] {
                sum += x[self.columns[k] as usize] * self.values[k];
            }
            *out = sum;
        }
    }

    /// Steps of conjugate gradients from `x` toward the solution of A·x = b, with the diagonal as preconditioner.
    fn solve(&self, b: &[DVec2], x: &mut [DVec2]) {
        let dot = |a: &[DVec2], b: &[DVec2]| a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum::<f64>();
        let mut product = vec![DVec2::ZERO; x.len()];
        self.times(x, &mut product);
        let mut rest: Vec<DVec2> = b.iter().zip(&product).map(|(b, p)| b - p).collect();
        let scaled = |rest: &[DVec2]| -> Vec<DVec2> {
            let each = rest.iter().zip(&self.diagonal);
            each.map(|(r, d)| r / d.max(f64::MIN_POSITIVE)).collect()
        };
        let mut z = scaled(&rest);
        let mut direction = z.clone();
        let mut now = dot(&rest, &z);
        let enough = 1e-12 * now;
        // Errors of the size of a chart need steps in proportion to its vertices along an axis.
        let steps = (x.len() as f64).sqrt().clamp(20.0, 100.0) as usize;
        for _ in 0..steps {
            self.times(&direction, &mut product);
            let step = now / dot(&direction, &product);
            if !step.is_finite() || now <= enough {
                return;
            }
            for (i, d) in direction.iter().enumerate() {
                x[i] += d * step;
                rest[i] -= product[i] * step;
            }
            z = scaled(&rest);
            let next = dot(&rest, &z);
            let ratio = next / now;
            now = next;
            for (d, z) in direction.iter_mut().zip(&z) {
                *d = *z + *d * ratio;
            }
        }
    }
}

/// The cotangents of a triangle's angles at its corners, kept within a range in which the matrix stays definite.
fn cotangents(t: &[DVec2; 3]) -> [f64; 3] {
    [0, 1, 2].map(|i| {
        let (u, v) = (t[(i + 1) % 3] - t[i], t[(i + 2) % 3] - t[i]);
        let cotangent = u.dot(v) / u.perp_dot(v).abs();
        if cotangent.is_finite() {
            cotangent.clamp(0.05, 20.0)
        } else {
            1.0
        }
    })
}

/// Moves texture coordinates such that each triangle is nearly a rotated copy of its shape on the surface (the local and
/// global steps of Liu et al. 2008, *A Local/Global Approach to Mesh Parameterization*, as rigid as possible).
///
/// `faces` are indices into `points`, and `shapes` are the triangles of the surface in planes of their own, of areas
/// `areas`. Vertices of triangles that turned over then move to the mean of their neighbors, as in the embedding of Tutte
/// (1963), but for those at the border. Triangles may still be turned.
pub(super) fn relax(
    faces: &[[u32; 3]],
    shapes: &[[DVec2; 3]],
    areas: &[f64],
    points: &mut [DVec2],
) {
    let weights: Vec<[f64; 3]> = shapes.iter().map(cotangents).collect();
    let mut edges = Vec::with_capacity(6 * faces.len());
    for (face, w) in faces.iter().zip(&weights) {
        for i in 0..3 {
            edges.push((face[(i + 1) % 3], face[(i + 2) % 3], w[i]));
        }
    }
    let matrix = Matrix::laplacian(points.len(), edges);
    let mut sums = vec![DVec2::ZERO; points.len()];
    for _ in 0..ROUNDS {
        sums.fill(DVec2::ZERO);
        for ((face, shape), w) in faces.iter().zip(shapes).zip(&weights) {
            let at = face.map(|v| points[v as usize]);
            // The rotation as a complex number.
            let mut turn = DVec2::ZERO;
            for (i, w) in w.iter().enumerate() {
                let (j, k) = ((i + 1) % 3, (i + 2) % 3);
                let (x, u) = (shape[k] - shape[j], at[k] - at[j]);
                turn += DVec2::new(x.dot(u), x.perp_dot(u)) * *w;
            }
            let turn = turn.normalize_or(DVec2::X);
            for (i, w) in w.iter().enumerate() {
                let (j, k) = ((i + 1) % 3, (i + 2) % 3);
                let along = turn.rotate(shape[k] - shape[j]) * *w;
                sums[face[k] as usize] += along;
                sums[face[j] as usize] -= along;
            }
        }
        matrix.solve(&sums, points);
    }
    untangle(faces, areas, &matrix, points);
}

/// Moves the inner vertices of turned triangles to the means of their neighbors, until no triangle is turned.
fn untangle(faces: &[[u32; 3]], areas: &[f64], matrix: &Matrix, points: &mut [DVec2]) {
    let mut wrong = turned(faces, areas, points);
    if wrong.is_empty() {
        return;
    }
    let at_border = border(faces, points.len());
    for _ in 0..UNTANGLED {
        let corners = wrong.iter().flat_map(|&f| faces[f as usize]);
        let mut vertices: Vec<u32> = corners.filter(|&v| !at_border[v as usize]).collect();
        vertices.sort_unstable();
        vertices.dedup();
        for v in vertices {
            let around = &matrix.columns[matrix.starts[v as usize]..matrix.starts[v as usize + 1]];
            let sum: DVec2 = around.iter().map(|&w| points[w as usize]).sum();
            points[v as usize] = sum / around.len() as f64;
        }
        wrong = turned(faces, areas, points);
        if wrong.is_empty() {
            return;
        }
    }
}
