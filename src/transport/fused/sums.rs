//! Sums of derivatives.

use glam::{DVec2, DVec3};

/// Sums of derivatives by what a scene is made of.
pub(crate) struct Sums {
    pub corners: Vec<[DVec3; 3]>,
    pub normal: Vec<DVec3>,
    pub area: Vec<f64>,
    pub velocity: Vec<DVec3>,
    pub uvs: Vec<[DVec2; 3]>,
    pub normals: Vec<[DVec3; 3]>,
    pub diffuse: Vec<DVec3>,
    pub diffuse_texels: Vec<DVec3>,
    pub specular: Vec<DVec3>,
    pub specular_texels: Vec<DVec3>,
    pub exponent: Vec<f64>,
    pub emission: Vec<DVec3>,
    pub sky: Vec<DVec3>,
    pub camera: CameraSums,
}

#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct CameraSums {
    pub eye: DVec3,
    pub forward: DVec3,
    pub right: DVec3,
    pub up: DVec3,
    pub half_height: f64,
    pub lens: [f64; 2],
}

impl Sums {
    /// Adds others.
    pub fn add(&mut self, o: &Self) {
        fn each<T: Copy + std::ops::AddAssign>(a: &mut [T], b: &[T]) {
            a.iter_mut().zip(b).for_each(|(a, b)| *a += *b);
        }
        for (a, b) in self.corners.iter_mut().zip(&o.corners) {
            each(a, b);
        }
        each(&mut self.normal, &o.normal);
        each(&mut self.area, &o.area);
        each(&mut self.velocity, &o.velocity);
        for (a, b) in self.uvs.iter_mut().zip(&o.uvs) {
            each(a, b);
        }
        for (a, b) in self.normals.iter_mut().zip(&o.normals) {
            each(a, b);
        }
        each(&mut self.diffuse, &o.diffuse);
        each(&mut self.diffuse_texels, &o.diffuse_texels);
        each(&mut self.specular, &o.specular);
        each(&mut self.specular_texels, &o.specular_texels);
        each(&mut self.exponent, &o.exponent);
        each(&mut self.emission, &o.emission);
        each(&mut self.sky, &o.sky);
        let (a, b) = (&mut self.camera, &o.camera);
        a.eye += b.eye;
        a.forward += b.forward;
        a.right += b.right;
        a.up += b.up;
        a.half_height += b.half_height;
        each(&mut a.lens, &b.lens);
    }
}
