//! The triangles of a scene's objects, packed into flat lists.

use glam::DVec3;
use rayon::prelude::*;

use crate::accel::HostTriangle;
use crate::model::{V3, v3};
use crate::scene::{HostAttribute, HostScene, SceneFrame};

/// The place of an object's parts in the scene's lists.
#[derive(Clone, Debug)]
pub(crate) struct ObjectPart {
    pub first_triangle: usize,
    pub first_vertex: usize,
    pub vertices: usize,
    pub first_uv: usize,
    pub first_normal: usize,
    pub first_colour: usize,
    pub first_tangent: usize,
    /// Whether it has shading normals.
    pub smooth: bool,
}

/// A triangle, in inner coordinates at the start of the shutter.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Triangle {
    pub corners: [V3; 3],
    /// Unit normal of the front.
    pub normal: V3,
    /// normal · corner.
    pub plane: f32,
    pub area: f32,
    pub material: u32,
    pub object: u32,
}

/// Values at the corners of triangles that few scenes have; empty in the others.
#[derive(Default)]
pub(crate) struct Corners {
    /// Rows of the values at the corners of each triangle, `u32::MAX` where it has none.
    pub rows: Vec<[u32; 3]>,
    pub values: Vec<V3>,
}

impl Corners {
    /// Adds those of an object with so many faces, unless no object of the scene has any; takes the first three
    /// numbers of each row.
    fn add<const C: usize>(&mut self, of: Option<&HostAttribute<C>>, faces: usize, any: bool) {
        if !any {
            return;
        }
        let first = self.values.len() as u32;
        match of {
            None => self.rows.resize(self.rows.len() + faces, [u32::MAX; 3]),
            Some(a) => {
                let rows = a.faces.iter().map(|f| f.map(|row| row + first));
                self.rows.extend(rows);
                self.values
                    .extend(a.values.iter().map(|v| v3(v[0], v[1], v[2])));
            }
        }
    }
}

/// Vertices of an object that several cores are worth waking for.
const TOGETHER: usize = 4096;

/// Lists of a scene that grow object by object.
#[derive(Default)]
pub(super) struct Lists {
    /// Vertices, in inner coordinates.
    pub vertices: Vec<DVec3>,
    /// The material and the object of each triangle.
    pub owners: Vec<[u32; 2]>,
    pub objects: Vec<ObjectPart>,
    pub counted: Vec<usize>,
    pub vertex_rows: Vec<[u32; 3]>,
    pub uv_rows: Vec<[u32; 3]>,
    pub normal_rows: Vec<[u32; 3]>,
    pub uvs: Vec<[f32; 2]>,
    pub normals: Vec<V3>,
    pub colours: Corners,
    pub tangents: Corners,
    pub tangent_sides: Vec<f32>,
}

impl Lists {
    /// Those of all objects of a scene.
    pub fn new(scene: &HostScene, frame: &SceneFrame) -> Self {
        let mut lists = Self::default();
        let coloured = scene.objects.iter().any(|o| o.colours.is_some());
        let tangents = scene.objects.iter().any(|o| o.tangents.is_some());
        for i in 0..scene.objects.len() {
            lists.add_object(scene, i, frame, [coloured, tangents]);
        }
        lists
    }

    /// Adds an object; of colours and tangents it says whether any object of the scene has them.
    fn add_object(
        &mut self,
        scene: &HostScene,
        i: usize,
        frame: &SceneFrame,
        [coloured, tangents]: [bool; 2],
    ) {
        let o = &scene.objects[i];
        let part = ObjectPart {
            first_triangle: self.owners.len(),
            first_vertex: self.vertices.len(),
            vertices: o.positions.len(),
            first_uv: self.uvs.len(),
            first_normal: self.normals.len(),
            first_colour: self.colours.values.len(),
            first_tangent: self.tangents.values.len(),
            smooth: o.normals.is_some(),
        };
        if !o.faces.is_empty() {
            self.counted.push(i);
        }
        let inner = |&p: &[f64; 3]| frame.inner(p.into());
        if o.positions.len() < TOGETHER {
            self.vertices.extend(o.positions.iter().map(inner));
        } else {
            self.vertices.par_extend(o.positions.par_iter().map(inner));
        }
        let owner = |f: usize| {
            let own = o.face_materials.get(f).copied().unwrap_or(0);
            [o.first_material as u32 + own, i as u32]
        };
        self.owners.extend((0..o.faces.len()).map(owner));
        let rows = |to: &mut Vec<[u32; 3]>, faces: Option<&Vec<[u32; 3]>>, first: usize| match faces
        {
            None => to.resize(to.len() + o.faces.len(), [u32::MAX; 3]),
            Some(faces) => to.extend(faces.iter().map(|face| face.map(|v| v + first as u32))),
        };
        rows(&mut self.vertex_rows, Some(&o.faces), part.first_vertex);
        let of_uvs = o.uvs.as_ref().map(|a| &*a.faces);
        rows(&mut self.uv_rows, of_uvs, part.first_uv);
        let of_normals = o.normals.as_ref().map(|a| &*a.faces);
        rows(&mut self.normal_rows, of_normals, part.first_normal);
        if let Some(HostAttribute { values, .. }) = &o.uvs {
            self.uvs.extend_from_slice(values);
        }
        if let Some(HostAttribute { values, .. }) = &o.normals {
            self.normals
                .extend(values.iter().map(|n| v3(n[0], n[1], n[2])));
        }
        self.colours
            .add(o.colours.as_ref(), o.faces.len(), coloured);
        self.tangents
            .add(o.tangents.as_ref(), o.faces.len(), tangents);
        let tangents = o.tangents.iter().flat_map(|t| &t.values);
        self.tangent_sides.extend(tangents.map(|t| t[3]));
        self.objects.push(part);
    }

    /// The corners of a triangle.
    #[inline(always)]
    pub fn corners(&self, k: usize) -> [DVec3; 3] {
        self.vertex_rows[k].map(|v| self.vertices[v as usize])
    }

    /// All triangles as boxes are made about them, from the ways of objects over the shutter. One whose area has no
    /// inverse in f32 counts as without area and is never hit.
    pub fn for_boxes(&self, velocity: impl Fn(u32) -> DVec3 + Sync) -> Vec<HostTriangle> {
        let triangle = |(k, &[_, object]): (usize, &[u32; 2])| {
            let mut t = HostTriangle::new(self.corners(k), velocity(object), true);
            let area = t.area() as f32;
            t.valid &= area > 1e-35 && area.is_finite();
            t
        };
        self.owners.par_iter().enumerate().map(triangle).collect()
    }

    /// All triangles as paths meet them, from those in boxes.
    pub fn triangles(&self, in_boxes: &[HostTriangle]) -> Vec<Triangle> {
        let both = self.owners.par_iter().zip(in_boxes);
        let triangle = |(&[material, object], t): (&[u32; 2], &HostTriangle)| {
            let (mut normal, mut plane) = (v3(0.0, 0.0, 1.0), 0.0);
            if t.valid {
                normal = t.normal.into();
                plane = t.normal.dot(t.corners[0]) as f32;
            }
            Triangle {
                corners: t.corners.map(|c| c.into()),
                normal,
                plane,
                area: t.area() as f32,
                material,
                object,
            }
        };
        both.map(triangle).collect()
    }
}
