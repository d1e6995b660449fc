//! The triangles of a scene's objects, packed into flat lists.

use glam::DVec3;
use rayon::prelude::*;

use crate::accel::HostTriangle;
use crate::host::{HostAttribute, HostScene, SceneFrame};
use crate::model::triangle::{self, AREA};
use crate::trace::{NONE, TRIANGLE};

/// The offsets of an object's values in the lists of the scene.
#[derive(Clone, Debug)]
pub struct ObjectPart {
    pub first_triangle: usize,
    pub first_vertex: usize,
    pub vertices: usize,
    pub first_uv: usize,
    pub first_normal: usize,
    pub first_color: usize,
    pub first_tangent: usize,
    /// Whether the object has shading normals.
    pub smooth: bool,
}

/// Values at triangle corners that few scenes have. Both lists are empty in other scenes.
#[derive(Default)]
pub struct Corners<const C: usize> {
    /// For each triangle, the rows of the values at its corners, or [`NONE`] if it has none.
    pub rows: Vec<[u32; 3]>,
    pub values: Vec<[f32; C]>,
}

impl<const C: usize> Corners<C> {
    /// Returns the value at a corner of a triangle.
    pub fn at(&self, k: usize, corner: usize) -> Option<[f32; C]> {
        match self.rows.get(k)?[corner] {
            NONE => None,
            row => Some(self.values[row as usize]),
        }
    }

    /// Adds the values of an object with `faces` faces, unless no object of the scene has any.
    fn add(&mut self, of: Option<&HostAttribute<C>>, faces: usize, any: bool) {
        if !any {
            return;
        }
        let first = self.values.len() as u32;
        match of {
            None => self.rows.resize(self.rows.len() + faces, [NONE; 3]),
            Some(a) => {
                let rows = a.faces.iter().map(|f| f.map(|row| row + first));
                self.rows.extend(rows);
                self.values.extend(&a.values);
            }
        }
    }
}

/// The number of rows from which several cores fill a list.
const TOGETHER: usize = 4096;

/// Adds `count` rows to a list.
fn extend<T: Send>(list: &mut Vec<T>, count: usize, row: impl Fn(usize) -> T + Sync + Send) {
    if count < TOGETHER {
        list.extend((0..count).map(row));
    } else {
        list.par_extend((0..count).into_par_iter().map(row));
    }
}

/// The lists of a scene's triangles ([`Scene`](crate::trace::Scene)).
#[derive(Default)]
pub struct Lists {
    /// Vertices in inner coordinates.
    vertices: Vec<DVec3>,
    pub objects: Vec<ObjectPart>,
    /// The indices of the objects that have triangles, in order.
    pub counted: Vec<usize>,
    pub surfaces: Vec<[f32; triangle::NUMBERS]>,
    pub triangles: Vec<[u32; TRIANGLE as usize]>,
    pub vertex_rows: Vec<[u32; 3]>,
    pub uvs: Vec<[f32; 2]>,
    pub normals: Vec<[f32; 3]>,
    pub colors: Corners<3>,
    pub tangents: Corners<4>,
}

impl Lists {
    /// Packs all objects of a scene. [`add_surfaces`](Self::add_surfaces) adds the surfaces.
    pub fn new(scene: &HostScene, frame: &SceneFrame) -> Self {
        let mut lists = Self::default();
        let colored = scene.objects.iter().any(|o| o.colors.is_some());
        let tangents = scene.objects.iter().any(|o| o.tangents.is_some());
        let faces = scene.objects.iter().map(|o| o.faces.len()).sum();
        lists.triangles.reserve_exact(faces);
        lists.vertex_rows.reserve_exact(faces);
        for i in 0..scene.objects.len() {
            lists.add_object(scene, i, frame, [colored, tangents]);
        }
        // Colors apply only to materials whose model has an albedo.
        for (rows, words) in lists.colors.rows.iter_mut().zip(&lists.triangles) {
            if !scene.materials[words[0] as usize].kind.bsdf.is_tinted() {
                *rows = [NONE; 3];
            }
        }
        lists
    }

    /// Adds an object. The flags state whether any object of the scene has colors, and whether any has tangents.
    fn add_object(
        &mut self,
        scene: &HostScene,
        i: usize,
        frame: &SceneFrame,
        [colored, tangents]: [bool; 2],
    ) {
        let o = &scene.objects[i];
        let part = ObjectPart {
            first_triangle: self.triangles.len(),
            first_vertex: self.vertices.len(),
            vertices: o.positions.len(),
            first_uv: self.uvs.len(),
            first_normal: self.normals.len(),
            first_color: self.colors.values.len(),
            first_tangent: self.tangents.values.len(),
            smooth: o.normals.is_some(),
        };
        if !o.faces.is_empty() {
            self.counted.push(i);
        }
        extend(&mut self.vertices, o.positions.len(), |v| {
            frame.inner(o.positions[v].into())
        });
        let rows = |of: Option<&Vec<[u32; 3]>>, f: usize, first: usize| match of {
            None => [NONE; 3],
            Some(faces) => faces[f].map(|v| v + first as u32),
        };
        let of_uvs = o.uvs.as_ref().map(|a| &*a.faces);
        let of_normals = o.normals.as_ref().map(|a| &*a.faces);
        extend(&mut self.triangles, o.faces.len(), |f| {
            let own = o.face_materials.get(f).copied().unwrap_or(0);
            let [a, b, c] = rows(of_uvs, f, part.first_uv);
            let [p, q, r] = rows(of_normals, f, part.first_normal);
            [o.first_material as u32 + own, i as u32, a, b, c, p, q, r]
        });
        extend(&mut self.vertex_rows, o.faces.len(), |f| {
            rows(Some(&o.faces), f, part.first_vertex)
        });
        if let Some(HostAttribute { values, .. }) = &o.uvs {
            self.uvs.extend_from_slice(values);
        }
        if let Some(HostAttribute { values, .. }) = &o.normals {
            self.normals.extend_from_slice(values);
        }
        self.colors.add(o.colors.as_ref(), o.faces.len(), colored);
        self.tangents
            .add(o.tangents.as_ref(), o.faces.len(), tangents);
        self.objects.push(part);
    }

    /// Returns the corners of a triangle.
    #[inline(always)]
    pub fn corners(&self, k: usize) -> [DVec3; 3] {
        self.vertex_rows[k].map(|v| self.vertices[v as usize])
    }

    /// Returns all triangles as the hierarchy takes them, given the displacement of each object over the shutter. A
    /// triangle whose area has no inverse in f32 counts as a triangle without area and is never hit.
    pub fn for_boxes(
        &self,
        velocity: impl Fn(u32) -> DVec3 + Sync + Send,
    ) -> impl IndexedParallelIterator<Item = HostTriangle> {
        let triangle = move |k: usize| {
            let object = self.triangles[k][1];
            let mut t = HostTriangle::new(self.corners(k), velocity(object), true);
            t.valid &= triangle::has_area(t.area() as f32);
            t
        };
        (0..self.triangles.len()).into_par_iter().map(triangle)
    }

    /// Adds the surfaces of all triangles, as paths read them, from the triangles of the hierarchy.
    pub fn add_surfaces(&mut self, in_boxes: &[HostTriangle]) {
        let surface = |t: &HostTriangle| {
            let [a, b, c] = t.corners;
            let (normal, plane) = match t.valid {
                true => (t.normal, t.normal.dot(a)),
                false => (DVec3::Z, 0.0),
            };
            let vectors = [a, b, c, normal].map(|v| v.as_vec3().to_array());
            let mut surface = [0.0; triangle::NUMBERS];
            let (corners_and_normal, others) = surface.split_at_mut(AREA - 1);
            corners_and_normal.copy_from_slice(vectors.as_flattened());
            others.copy_from_slice(&[plane as f32, t.area() as f32]);
            surface
        };
        self.surfaces = in_boxes.par_iter().map(surface).collect();
        // The surfaces contain the vertices now, but not with the precision that GPUs take.
        if !cfg!(feature = "gpu") {
            self.vertices = Vec::new();
        }
    }

    /// Returns each vertex as the sum of two numbers per axis, of which the first is rounded.
    #[cfg(feature = "gpu")]
    pub fn in_two_parts(&self) -> Vec<[[f32; 3]; 2]> {
        let parts = |v: &DVec3| {
            let coarse = v.as_vec3();
            [coarse, (*v - coarse.as_dvec3()).as_vec3()].map(|part| part.to_array())
        };
        self.vertices.par_iter().map(parts).collect()
    }
}
