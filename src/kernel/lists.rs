//! The triangles of a scene's objects, packed into flat lists.

use std::sync::Arc;

use glam::DVec3;

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

/// Lists of a scene that grow object by object.
#[derive(Default)]
pub(super) struct Lists {
    pub triangles: Vec<Triangle>,
    pub host: Vec<HostTriangle>,
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
    pub fn add_object(&mut self, scene: &HostScene, i: usize, frame: &SceneFrame, velocity: DVec3) {
        let o = &scene.objects[i];
        let part = ObjectPart {
            first_triangle: self.triangles.len(),
            first_vertex: self
                .objects
                .last()
                .map_or(0, |o| o.first_vertex + o.vertices),
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
        let inner: Vec<DVec3> = o.positions.iter().map(|&p| frame.inner(p.into())).collect();
        for (f, face) in o.faces.iter().enumerate() {
            let own = o.face_materials.get(f).copied().unwrap_or(0);
            let corners = face.map(|v| inner[v as usize]);
            let material = o.first_material as u32 + own;
            self.add_triangle(corners, velocity, material, i as u32);
            self.vertex_rows
                .push(face.map(|v| v + part.first_vertex as u32));
            let rows = |faces: Option<&Arc<Vec<[u32; 3]>>>, first: usize| {
                faces.map_or([u32::MAX; 3], |faces| faces[f].map(|v| v + first as u32))
            };
            self.uv_rows
                .push(rows(o.uvs.as_ref().map(|a| &a.faces), part.first_uv));
            self.normal_rows.push(rows(
                o.normals.as_ref().map(|a| &a.faces),
                part.first_normal,
            ));
        }
        if let Some(HostAttribute { values, .. }) = &o.uvs {
            self.uvs.extend_from_slice(values);
        }
        if let Some(HostAttribute { values, .. }) = &o.normals {
            self.normals
                .extend(values.iter().map(|n| v3(n[0], n[1], n[2])));
        }
        let any = scene.objects.iter().any(|o| o.colours.is_some());
        self.colours.add(o.colours.as_ref(), o.faces.len(), any);
        let any = scene.objects.iter().any(|o| o.tangents.is_some());
        self.tangents.add(o.tangents.as_ref(), o.faces.len(), any);
        let tangents = o.tangents.iter().flat_map(|t| &t.values);
        self.tangent_sides.extend(tangents.map(|t| t[3]));
        self.objects.push(part);
    }

    /// Adds a triangle; one whose area has no inverse in f32 counts as without area and is never hit.
    fn add_triangle(&mut self, corners: [DVec3; 3], velocity: DVec3, material: u32, object: u32) {
        let mut t = HostTriangle::new(corners, velocity, true);
        let area = t.area() as f32;
        t.valid &= area > 1e-35 && area.is_finite();
        let (mut normal, mut plane, mut own) = (v3(0.0, 0.0, 1.0), 0.0, 0.0);
        if t.valid {
            normal = t.normal.into();
            plane = t.normal.dot(t.corners[0]) as f32;
            own = area;
        }
        self.triangles.push(Triangle {
            corners: corners.map(|c| c.into()),
            normal,
            plane,
            area: own,
            material,
            object,
        });
        self.host.push(t);
    }
}
