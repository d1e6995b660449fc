//! Meshes from formulas. All faces are counter-clockwise seen from outside.
//!
//! ```
//! use softray::prelude::*;
//! let device = Device::flex();
//! let meshes = [
//!     shapes::triangle([0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], &device),
//!     shapes::quad([0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], &device),
//!     shapes::cube(&device),
//!     shapes::icosahedron(&device),
//!     shapes::icosphere(1, &device),
//!     shapes::torus(1.0, 0.3, 24, 12, &device),
//!     shapes::cylinder(0.5, 2.0, 24, &device),
//!     shapes::plane_grid(4.0, 4.0, 2, 2, &device),
//! ];
//! assert_eq!(meshes.map(|mesh| mesh.faces.len()), [1, 2, 12, 20, 80, 576, 96, 8]);
//! ```

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use burn::tensor::Device;

use super::mesh::{host_tensor, split_in_four};
use super::{CornerAttribute, Mesh};

/// Creates a mesh of one triangle. On its front side the corners run counter-clockwise.
///
/// [`shapes`](self) has an example.
pub fn triangle(a: [f64; 3], b: [f64; 3], c: [f64; 3], device: &Device) -> Mesh {
    Mesh::from_host(&[a, b, c], vec![[0, 1, 2]], device)
}

/// Creates two triangles, a b c and a c d, with the unit square as texture coordinates.
///
/// [`shapes`](self) has an example.
pub fn quad(a: [f64; 3], b: [f64; 3], c: [f64; 3], d: [f64; 3], device: &Device) -> Mesh {
    let uvs = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    Mesh::from_host(&[a, b, c, d], vec![[0, 1, 2], [0, 2, 3]], device)
        .with_uvs(host_tensor(&uvs, device))
}

/// Creates a cube of side 2 about the origin, with 8 shared vertices and 12 faces.
///
/// [`shapes`](self) has an example.
pub fn cube(device: &Device) -> Mesh {
    let vertices: Vec<[f64; 3]> = (0..8)
        .map(|i| [1, 2, 4].map(|bit| if i & bit == 0 { -1.0 } else { 1.0 }))
        .collect();
    let sides: [[u32; 4]; 6] = [
        [0, 4, 6, 2],
        [1, 3, 7, 5],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 2, 3, 1],
        [4, 5, 7, 6],
    ];
    let faces = sides
        .iter()
        .flat_map(|s| [[s[0], s[1], s[2]], [s[0], s[2], s[3]]])
        .collect();
    Mesh::from_host(&vertices, faces, device)
}

/// Creates a regular icosahedron of circumradius 1.
///
/// [`shapes`](self) has an example.
pub fn icosahedron(device: &Device) -> Mesh {
    icosphere(0, device)
}

/// Creates a unit sphere of 20·4ⁿ faces: an icosahedron that is subdivided n times.
///
/// [`shapes`](self) has an example.
pub fn icosphere(subdivisions: u32, device: &Device) -> Mesh {
    let phi = (1.0 + 5f64.sqrt()) / 2.0;
    let unit = |v: [f64; 3]| glam::DVec3::from(v).normalize().to_array();
    let mut vertices = Vec::new();
    for (s, t) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
        vertices.push(unit([0.0, s, t * phi]));
        vertices.push(unit([s, t * phi, 0.0]));
        vertices.push(unit([t * phi, 0.0, s]));
    }
    let mut faces = hull_of_icosahedron(&vertices);
    for _ in 0..subdivisions {
        faces = split_in_four(&faces, |i, j| {
            let (p, q) = (vertices[i as usize], vertices[j as usize]);
            vertices.push(unit([p[0] + q[0], p[1] + q[1], p[2] + q[2]]));
            vertices.len() as u32 - 1
        });
    }
    Mesh::from_host(&vertices, faces, device)
}

/// Creates a unit sphere about the origin with smooth shading normals and texture coordinates.
///
/// It has `segments` divisions around the y axis and `rings` divisions from pole to pole; values below 3 and 2 are
/// raised to these. The number of faces is 2·segments·(rings − 1). The sphere is closed, with one vertex at each pole.
///
/// u runs once around the y axis, counter-clockwise seen from +y, from 0 at +z. v is proportional to the polar angle,
/// from 0 at the pole −y to 1 at +y. An image of aspect 2 × 1 that is laid out as a map of the world therefore appears
/// unmirrored from outside. The normals are the normals of the sphere and do not follow changed vertices: see
/// [`Mesh::smooth_normals`]. For triangles of similar size use an [`icosphere`].
///
/// ```
/// use softray::prelude::*;
/// let device = Device::flex();
/// let globe = shapes::sphere(32, 16, &device).scaled(0.5).translated([0.0, 0.5, 0.0]);
/// assert_eq!(globe.faces.len(), 2 * 32 * 15);
/// assert!(globe.uvs.is_some() && globe.normals.is_some());
/// ```
pub fn sphere(segments: usize, rings: usize, device: &Device) -> Mesh {
    let (n, rings) = (segments.max(3), rings.max(2));
    let (mut vertices, mut uvs) = (vec![[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]], Vec::new());
    let (mut faces, mut uv_faces) = (Vec::new(), Vec::new());
    // Rings between the poles, from below. Texture coordinates have one more column, for the seam.
    for j in 1..rings {
        let v = j as f64 / rings as f64;
        let (radius, height) = (PI * v).sin_cos();
        for i in 0..=n {
            let u = i as f64 / n as f64;
            uvs.push([u, v]);
            if i < n {
                let (sin, cos) = (TAU * u).sin_cos();
                vertices.push([radius * sin, -height, radius * cos]);
            }
        }
    }
    // Each face at a pole has its own texture coordinates there, in the middle of the face.
    let poles = uvs.len() as u32;
    for v in [0.0, 1.0] {
        uvs.extend((0..n).map(|i| [(i as f64 + 0.5) / n as f64, v]));
    }
    let at = |i: usize, j: usize| (2 + j * n + i % n) as u32;
    let uv_at = |i: usize, j: usize| (j * (n + 1) + i) as u32;
    let top = rings - 2;
    for i in 0..n {
        let (south, north) = (poles + i as u32, poles + (n + i) as u32);
        faces.push([0, at(i + 1, 0), at(i, 0)]);
        uv_faces.push([south, uv_at(i + 1, 0), uv_at(i, 0)]);
        for j in 0..top {
            let quad = |at: &dyn Fn(usize, usize) -> u32| {
                let (p, q, r, s) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
                [[p, q, r], [p, r, s]]
            };
            faces.extend(quad(&at));
            uv_faces.extend(quad(&uv_at));
        }
        faces.push([1, at(i, top), at(i + 1, top)]);
        uv_faces.push([north, uv_at(i, top), uv_at(i + 1, top)]);
    }
    let mut mesh =
        Mesh::from_host(&vertices, faces, device).with_normals(host_tensor(&vertices, device));
    mesh.uvs = Some(CornerAttribute {
        values: host_tensor(&uvs, device),
        faces: Arc::new(uv_faces),
    });
    mesh
}

/// Returns the 20 triples of mutually nearest vertices, wound outwards.
fn hull_of_icosahedron(vertices: &[[f64; 3]]) -> Vec<[u32; 3]> {
    let at = |i: usize| glam::DVec3::from(vertices[i]);
    // Neighbors on the unit icosahedron have a dot product of 1/√5, other pairs −1/√5 or −1.
    let near = |i: usize, j: usize| at(i).dot(at(j)) > 0.4;
    let mut faces = Vec::new();
    for i in 0..12 {
        for j in i + 1..12 {
            for k in j + 1..12 {
                if near(i, j) && near(j, k) && near(k, i) {
                    let outward = at(i).dot(at(j).cross(at(k))) > 0.0;
                    let (i, j, k) = (i as u32, j as u32, k as u32);
                    faces.push(if outward { [i, j, k] } else { [i, k, j] });
                }
            }
        }
    }
    faces
}

/// Creates a closed torus about the y axis.
/// `major` is the distance from the axis to the middle of the tube and `minor` the radius of the tube, in scene units.
/// There are `segments` divisions around the axis and `rings` around the tube; values below 3 are raised to 3.
///
/// [`shapes`](self) has an example.
pub fn torus(major: f64, minor: f64, segments: usize, rings: usize, device: &Device) -> Mesh {
    let (segments, rings) = (segments.max(3), rings.max(3));
    let mut vertices = Vec::new();
    let mut faces = Vec::new();
    for i in 0..segments {
        let (sin, cos) = (TAU * i as f64 / segments as f64).sin_cos();
        for j in 0..rings {
            let (s, c) = (TAU * j as f64 / rings as f64).sin_cos();
            let r = major + minor * c;
            vertices.push([r * cos, minor * s, r * sin]);
            let at = |i: usize, j: usize| ((i % segments) * rings + j % rings) as u32;
            let (p, q) = (at(i, j), at(i + 1, j));
            let (r, s) = (at(i + 1, j + 1), at(i, j + 1));
            faces.extend([[p, s, r], [p, r, q]]);
        }
    }
    Mesh::from_host(&vertices, faces, device)
}

/// Creates a closed cylinder with caps about the y axis, centered at the origin. `segments` is raised to at least 3.
///
/// [`shapes`](self) has an example.
pub fn cylinder(radius: f64, height: f64, segments: usize, device: &Device) -> Mesh {
    let n = segments.max(3);
    let mut vertices = vec![[0.0, -height / 2.0, 0.0], [0.0, height / 2.0, 0.0]];
    let mut faces = Vec::new();
    for i in 0..n {
        let (sin, cos) = (TAU * i as f64 / n as f64).sin_cos();
        vertices.push([radius * cos, -height / 2.0, radius * sin]);
        vertices.push([radius * cos, height / 2.0, radius * sin]);
        let at = |i: usize, top: u32| 2 + 2 * (i % n) as u32 + top;
        let (p, q, r, s) = (at(i, 0), at(i + 1, 0), at(i + 1, 1), at(i, 1));
        faces.extend([[0, p, q], [1, r, s], [p, s, r], [p, r, q]]);
    }
    Mesh::from_host(&vertices, faces, device)
}

/// Creates a grid of rectangles in the plane y = 0, facing +y and centered at the origin.
/// `width` is along x and `depth` along z. The unit square is used as texture coordinates: u grows along +x, v along
/// −z. `columns` and `rows` are raised to at least 1.
///
/// [`shapes`](self) has an example.
pub fn plane_grid(width: f64, depth: f64, columns: usize, rows: usize, device: &Device) -> Mesh {
    let (columns, rows) = (columns.max(1), rows.max(1));
    let (mut vertices, mut uvs, mut faces) = (Vec::new(), Vec::new(), Vec::new());
    for j in 0..=rows {
        for i in 0..=columns {
            let (u, v) = (i as f64 / columns as f64, j as f64 / rows as f64);
            vertices.push([(u - 0.5) * width, 0.0, (0.5 - v) * depth]);
            uvs.push([u, v]);
            if i < columns && j < rows {
                let p = (j * (columns + 1) + i) as u32;
                let q = p + columns as u32 + 1;
                faces.extend([[p, p + 1, q + 1], [p, q + 1, q]]);
            }
        }
    }
    Mesh::from_host(&vertices, faces, device).with_uvs(host_tensor(&uvs, device))
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use super::*;
    use crate::geometry::host_values;

    fn device() -> Device {
        Device::flex()
    }

    fn volume(mesh: &Mesh) -> f64 {
        let v = mesh.host_vertices().expect("values");
        let at = |i: u32| glam::DVec3::from(v[i as usize]);
        let six = |f: &[u32; 3]| at(f[0]).dot(at(f[1]).cross(at(f[2])));
        mesh.faces.iter().map(six).sum::<f64>() / 6.0
    }

    fn is_closed(mesh: &Mesh) -> bool {
        let mut count = HashMap::new();
        for f in mesh.faces.iter() {
            for i in 0..3 {
                *count.entry((f[i], f[(i + 1) % 3])).or_insert(0) += 1;
            }
        }
        count
            .iter()
            .all(|(&(p, q), &n)| n == 1 && count.get(&(q, p)) == Some(&1))
    }

    #[test]
    fn solids_are_closed_and_wound_outwards() {
        for (mesh, faces, expected, tolerance) in [
            (cube(&device()), 12, 8.0, 1e-6),
            (icosahedron(&device()), 20, 2.5362, 1e-3),
            (icosphere(3, &device()), 1280, 4.0 / 3.0 * PI, 0.05),
            (
                torus(1.0, 0.3, 64, 32, &device()),
                4096,
                2.0 * PI * PI * 0.09,
                0.02,
            ),
            (sphere(64, 32, &device()), 3968, 4.0 / 3.0 * PI, 0.02),
            // Two pyramids of three sides.
            (sphere(0, 0, &device()), 6, 0.5 * 3f64.sqrt(), 1e-6),
            (cylinder(0.5, 2.0, 64, &device()), 256, PI * 0.5, 0.01),
        ] {
            assert_eq!(mesh.faces.len(), faces);
            assert!(is_closed(&mesh), "{faces} faces");
            assert!(
                (volume(&mesh) - expected).abs() < tolerance,
                "{}",
                volume(&mesh)
            );
        }
    }

    #[test]
    fn icospheres_are_round() {
        let vertices = icosphere(2, &device()).host_vertices().expect("values");
        assert_eq!(vertices.len(), 162);
        for v in vertices {
            assert!((glam::DVec3::from(v).length() - 1.0).abs() < 1e-6);
        }
    }

    /// Every face has the texture coordinates of its place, unmirrored and without a jump at the seam.
    #[test]
    fn spheres_have_texture_coordinates_and_normals() {
        let mesh = sphere(12, 7, &device());
        let v = mesh.host_vertices().expect("values");
        let normals = mesh.normals.as_ref().expect("normals");
        assert_eq!(host_values(&normals.values).expect("values"), v.concat());
        let uvs = mesh.uvs.as_ref().expect("uvs");
        let table = host_values(&uvs.values).expect("values");
        for (face, rows) in mesh.faces.iter().zip(uvs.faces.iter()) {
            let uv = rows.map(|r| [table[2 * r as usize], table[2 * r as usize + 1]]);
            for (&i, [u, height]) in face.iter().zip(uv) {
                let p = v[i as usize];
                assert!((p[1] + (PI * height).cos()).abs() < 1e-6);
                if i > 1 {
                    let (sin, cos) = (TAU * u).sin_cos();
                    let radius = p[0].hypot(p[2]);
                    assert!(
                        (p[0] - radius * sin).abs() < 1e-6 && (p[2] - radius * cos).abs() < 1e-6
                    );
                }
            }
            let [a, b, c] = uv.map(glam::DVec2::from);
            let twice = (b - a).perp_dot(c - a);
            assert!(twice > 0.0 && twice < 1.01 / 12.0 / 7.0, "{uv:?}");
        }
    }

    #[test]
    fn sheets_face_up() {
        let grid = plane_grid(2.0, 3.0, 4, 5, &device());
        assert_eq!(grid.faces.len(), 40);
        let v = grid.host_vertices().expect("values");
        for f in grid.faces.iter() {
            let [a, b, c] = f.map(|i| glam::DVec3::from(v[i as usize]));
            assert!((b - a).cross(c - a).y > 0.0);
        }
    }
}
