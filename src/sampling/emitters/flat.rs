//! What emitters are chosen by, as lists for kernels of GPUs.

use super::branches::{Axes, Sphere};
use super::many::ManyEmitters;
use super::node::Node;
use super::{Choice, Emitters, FEW};
use crate::accel::LANES;

/// A tree over emitters, and directional lights beside it.
#[derive(Default)]
pub(crate) struct FlatLights {
    /// Of eight branches of each node, then of all: centre, radius, mean axis, moments of axes and power.
    pub branches: Vec<[f32; 14]>,
    /// Children of each node, its parent and the branch of that, and whether it is a leaf.
    pub nodes: Vec<[u32; 11]>,
    /// The node and branch of each emitter; `u32::MAX` and its place among the distant ones of a directional light.
    pub places: Vec<[u32; 2]>,
    pub distant: Vec<u32>,
    /// Sums of the strengths of directional lights up to each.
    pub sums: Vec<f32>,
    /// Means of the directions to them, and of their products.
    pub axes: [f32; 9],
}

fn numbers(axes: &Axes) -> impl Iterator<Item = f32> {
    axes.mean.to_array().into_iter().chain(axes.moments)
}

fn of_sphere(sphere: &Sphere) -> [f32; 14] {
    let [x, y, z] = sphere.centre.to_array();
    let mut row = [0.0; 14];
    row[..4].copy_from_slice(&[x, y, z, sphere.radius]);
    row[4..13]
        .iter_mut()
        .zip(numbers(&sphere.axes))
        .for_each(|(to, n)| *to = n);
    row[13] = sphere.power;
    row
}

fn of_lane(node: &Node, lane: usize) -> [f32; 14] {
    let lists = node.centre.iter().chain([&node.radius]);
    let lists = lists.chain(&node.axis).chain(&node.moments);
    let mut row = [0.0; 14];
    for (to, lanes) in row.iter_mut().zip(lists.chain([&node.power])) {
        *to = lanes[lane];
    }
    row
}

impl ManyEmitters {
    fn flat(&self, count: usize) -> FlatLights {
        let mut flat = FlatLights {
            places: vec![[u32::MAX; 2]; count],
            distant: self.distant.clone(),
            sums: self.sums.clone(),
            ..FlatLights::default()
        };
        flat.axes
            .iter_mut()
            .zip(numbers(&self.axes))
            .for_each(|(to, n)| *to = n);
        if let Some(tree) = &self.tree {
            for node in &tree.nodes {
                let lanes = (0..LANES).map(|lane| of_lane(node, lane));
                flat.branches.extend(lanes);
                let mut row = [0; 11];
                row[..LANES].copy_from_slice(&node.child);
                row[8] = node.parent.node;
                row[9] = node.parent.lane;
                row[10] = u32::from(node.group.is_some());
                flat.nodes.push(row);
            }
            flat.branches.push(of_sphere(&tree.root));
            for (to, place) in flat.places.iter_mut().zip(&tree.places) {
                *to = [place.node, place.lane];
            }
        }
        for (i, &k) in self.distant.iter().enumerate() {
            flat.places[k as usize] = [u32::MAX, i as u32];
        }
        flat
    }
}

impl Emitters {
    /// The tree that one is chosen by, if there is one.
    pub fn flat(&self) -> Option<FlatLights> {
        match &self.by {
            Choice::Tree(many) => Some(many.flat(self.list.len() + self.lights.len())),
            _ => None,
        }
    }

    pub fn by_tree(&self) -> bool {
        matches!(self.by, Choice::Tree(_))
    }

    /// Whether they are chosen by the solid angles of all.
    pub fn by_solid_angle(&self) -> bool {
        matches!(self.by, Choice::SolidAngle)
    }

    /// Sums of fixed probabilities up to each emitter, where these are so many that one is searched for.
    pub fn running_sums(&self) -> Option<&[f32]> {
        (self.fixed.len() > FEW).then_some(&self.sums)
    }
}
