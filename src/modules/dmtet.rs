//! Surfaces of any topology, from signed distances at the nodes of tetrahedra.

use burn::config::Config;
use burn::module::{Module, Param};
use burn::tensor::{Device, Int, Tensor, TensorData};
use rayon::prelude::*;

use super::values::leaf;
use crate::error::{Error, Result};
use crate::geometry::{first_outside, host_values};
use crate::meshing::{Crossings, LEAST_PART, TriangleMesh, signed_distances};
use crate::scene::Mesh;

/// The most cells along an axis.
const MOST: usize = 512;
/// The largest offset of a node along an axis, over the length of a cell. Below 1/6, the matrix of a tetrahedron's edges is
/// diagonally dominant, so none turns inside out.
const LARGEST_OFFSET: f64 = 0.16;
/// The distance, over the length of a cell, that a node of the border has at least.
const OUTSIDE: f64 = 1e-3;
/// The least difference of distances along an edge, over the length of a cell, that derivatives are divided by.
const LEAST_DIFFERENCE: f64 = 1e-3;

/// A cube of `cells`³ cells, each divided into six tetrahedra, whose nodes have signed distances: the surface where these are
/// zero is a differentiable function of them (deep marching tetrahedra, Shen et al. 2021). It can have any number of parts
/// and handles, which come and go with the signs at nodes.
///
/// FlexiCubes (Shen et al. 2023) places vertices better at sharp edges, by weights for each cell, but its surfaces can cross
/// themselves and can touch at a vertex. Those of tetrahedra do neither, for any distances.
///
/// ```
/// use softray::modules::TetrahedralGrid;
/// use softray::prelude::*;
/// let device = Device::flex().autodiff();
/// let grid = TetrahedralGrid::new(24, 2.0)?;
/// // |p| − r is the signed distance to a ball: two grids, with balls of their own.
/// let far = grid.nodes(&device).powi_scalar(2).sum_dim(3).squeeze_dim::<3>(3).sqrt();
/// let radii = Tensor::<1>::from_floats([0.5, 0.8], &device).require_grad();
/// let distances = far.unsqueeze::<4>() - radii.clone().reshape([2, 1, 1, 1]);
/// let balls: Vec<Mesh> = grid.surfaces(distances, None)?;
/// // Vertices of the second move with its radius.
/// let mean = balls[1].vertices.clone().powi_scalar(2).sum_dim(1).sqrt().mean();
/// let gradient = radii.grad(&mean.backward()).expect("tracked").into_data();
/// gradient.assert_approx_eq::<f32>(&TensorData::from([0.0, 1.0]), Tolerance::absolute(1e-2));
/// # use burn::tensor::{TensorData, Tolerance};
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TetrahedralGrid {
    pub(super) cells: usize,
    pub(super) side: f64,
}

impl TetrahedralGrid {
    /// Creates a grid with `cells` cells along each axis, 2 to 512, in a cube about the origin with edges of the length `side`
    /// in scene units.
    ///
    /// # Errors
    /// If a number is out of its range.
    pub fn new(cells: usize, side: f64) -> Result<Self> {
        let (object, valid) = ("tetrahedral grid", (2..=MOST).contains(&cells));
        Error::unless(valid, object, "cells", cells, &format!("2 to {MOST}"))?;
        Error::unless_positive(object, "side", side)?;
        Ok(Self { cells, side })
    }

    /// The number N of nodes along each axis, one more than the cells.
    pub fn size(&self) -> usize {
        self.cells + 1
    }

    /// The length of a cell's edges, in scene units.
    pub fn step(&self) -> f64 {
        self.side / self.cells as f64
    }

    fn position(&self, node: [u32; 3]) -> [f64; 3] {
        node.map(|i| f64::from(i) * self.step() - self.side / 2.0)
    }

    /// The number of a node in the order of tensors: that along z changes fastest.
    pub(super) fn index(&self, [x, y, z]: [u32; 3]) -> usize {
        let n = self.size();
        (x as usize * n + y as usize) * n + z as usize
    }

    fn node(&self, index: usize) -> [u32; 3] {
        let n = self.size();
        [index / n / n, index / n % n, index % n].map(|i| i as u32)
    }

    fn at_border(&self, node: [u32; 3]) -> bool {
        node.iter().any(|&i| i == 0 || i as usize == self.cells)
    }

    /// The positions of all nodes, a list in the order of tensors.
    fn positions(&self) -> Vec<[f64; 3]> {
        let all = 0..self.size().pow(3);
        all.map(|i| self.position(self.node(i))).collect()
    }

    /// Returns the positions of the nodes `[N, N, N, 3]`, along x, y and z, in scene units: where a network computes distances.
    pub fn nodes(&self, device: &Device) -> Tensor<4> {
        let n = self.size();
        let values: Vec<f64> = self.positions().into_iter().flatten().collect();
        Tensor::from_data(TensorData::new(values, [n, n, n, 3]), device)
    }

    /// Returns the surfaces of S grids of signed distances `[S, N, N, N]` in scene units, negative inside, in their graph.
    /// Scenes with these meshes render in one [`render_batch`](crate::render::render_batch).
    ///
    /// Each surface is closed, manifold and oriented with its front outwards, and its faces do not cross, whatever the
    /// distances are. A vertex lies where the distance is 0 by linear interpolation along an edge of a tetrahedron, at
    /// least 2 % of the edge away from its ends; derivatives are those without this limit, so that a surface can pass
    /// nodes. The border of the cube is outside.
    ///
    /// Offsets `[S, N, N, N, 3]` move the nodes, by 0.16 · tanh(offset) of a cell's length along each axis, so that a coarse
    /// grid has vertices where the surface bends. Nodes of the border stay.
    ///
    /// Time: distances are read back to the host once. Only cells with nodes on both sides are visited after a pass over
    /// their signs.
    ///
    /// # Errors
    /// If shapes or float types are others, a value is not a finite number, or a grid has no surface.
    pub fn surfaces(&self, distances: Tensor<4>, offsets: Option<Tensor<5>>) -> Result<Vec<Mesh>> {
        let n = self.size();
        let [count, sides @ ..] = distances.dims();
        let object = "tetrahedral grid";
        let (shown, expected) = (
            format!("{:?}", distances.dims()),
            format!("[S, {n}, {n}, {n}]"),
        );
        let fits = count > 0 && sides == [n; 3];
        Error::unless(fits, object, "distances", shown, &expected)?;
        let wrong = |name: &str, i: usize, value: f64| {
            let node = self.node(i % n.pow(3));
            let field = format!("{name} of grid {} at {node:?}", i / n.pow(3));
            Error::invalid(object, field, value, "a finite number")
        };
        if let Some(offsets) = &offsets {
            let shown = format!("{:?} of {:?}", offsets.dims(), offsets.dtype());
            let expected = format!("[{count}, {n}, {n}, {n}, 3] of {:?}", distances.dtype());
            let fits =
                offsets.dims() == [count, n, n, n, 3] && offsets.dtype() == distances.dtype();
            Error::unless(fits, object, "offsets", shown, &expected)?;
            if let Some((i, value)) = first_outside(offsets, f64::is_finite)? {
                return Err(wrong("offset", i / 3, value));
            }
        }
        let values = host_values(&distances)?;
        if let Some(i) = values.iter().position(|v| !v.is_finite()) {
            return Err(wrong("distance", i, values[i]));
        }
        let grids = values.par_chunks(n.pow(3));
        let crossings: Vec<_> = grids.map(|values| self.crossings(values)).collect();
        let none = crossings.iter().position(|found| found.edges.is_empty());
        if let Some(grid) = none {
            let expected = "a negative distance at a node inside of the cube";
            let field = format!("distances of grid {grid}");
            return Err(Error::invalid(object, field, "all outside", expected));
        }
        let vertices = self.vertices(&crossings, &values, distances, offsets);
        let mut start = 0;
        let meshes = crossings.into_iter().map(|found| {
            let length = found.edges.len();
            let own = vertices.clone().narrow(0, start, length);
            start += length;
            Mesh::new(own, found.faces)
        });
        Ok(meshes.collect())
    }

    /// The vertices of all grids `[V, 3]`, one after the other.
    fn vertices(
        &self,
        crossings: &[Crossings],
        values: &[f64],
        distances: Tensor<4>,
        offsets: Option<Tensor<5>>,
    ) -> Tensor<2> {
        let size = self.size().pow(3);
        let grids = crossings.iter().enumerate();
        let edges: Vec<_> = grids
            .flat_map(|(grid, found)| found.edges.iter().map(move |&edge| (grid * size, edge)))
            .collect();
        let count = edges.len();
        let device = distances.device();
        let kind = (&device, distances.dtype());
        let constant = |values: Vec<f64>, columns: usize| {
            let data = TensorData::new(values, [count, columns]);
            Tensor::<2>::from_data(data, kind)
        };
        let rows = [0, 1].map(|end| {
            let row =
                |&(base, edge): &(usize, [[u32; 3]; 2])| (base + self.index(edge[end])) as i32;
            let rows: Vec<i32> = edges.iter().map(row).collect();
            Tensor::<1, Int>::from_ints(rows.as_slice(), &device)
        });
        let total = values.len();
        let flat = distances.reshape([total, 1]);
        let inner = [0, 1].map(|end| {
            let free = |(_, edge): &(usize, [[u32; 3]; 2])| f64::from(!self.at_border(edge[end]));
            constant(edges.iter().map(free).collect(), 1)
        });
        let step = self.step();
        // At the border, a node that would be inside has a small constant distance.
        let [a, b] = [0, 1].map(|end| {
            let own = flat.clone().select(0, rows[end].clone());
            let outside = own.clone().clamp_min(OUTSIDE * step);
            let free = inner[end].clone();
            own * free.clone() + outside * (free.neg() + 1.0)
        });
        let outwards = |&(base, edge): &(usize, [[u32; 3]; 2])| {
            let start = values[base + self.index(edge[0])] < 0.0 && !self.at_border(edge[0]);
            if start { -1.0 } else { 1.0 }
        };
        let sign = constant(edges.iter().map(outwards).collect(), 1);
        let difference = ((a.clone() - b) * sign.clone()).clamp_min(LEAST_DIFFERENCE * step);
        let part = a * sign / difference;
        let limited = part.clone().detach().clamp(LEAST_PART, 1.0 - LEAST_PART);
        let part = part.clone() - part.detach() + limited;
        let [start, end] = [0, 1].map(|end| {
            let place = |&(_, edge): &(usize, [[u32; 3]; 2])| self.position(edge[end]);
            let place = constant(edges.iter().flat_map(place).collect(), 3);
            let Some(offsets) = &offsets else {
                return place;
            };
            let own = offsets
                .clone()
                .reshape([total, 3])
                .select(0, rows[end].clone());
            place + own.tanh() * inner[end].clone() * (LARGEST_OFFSET * step)
        });
        start.clone() + (end - start) * part
    }

    /// The surface of one grid.
    fn crossings(&self, values: &[f64]) -> Crossings {
        let inside = |node| values[self.index(node)] < 0.0 && !self.at_border(node);
        let n = self.cells as u32;
        let straddling = |x: u32| {
            let cells = (0..n * n).map(move |i| [x, i / n, i % n]);
            let found = cells.filter(|&[x, y, z]| {
                let corner = |c: u32| inside([x + (c & 1), y + (c >> 1 & 1), z + (c >> 2)]);
                let first = corner(0);
                (1..8).any(|c| corner(c) != first)
            });
            found.collect::<Vec<_>>()
        };
        let slabs: Vec<_> = (0..n).into_par_iter().map(straddling).collect();
        Crossings::new(slabs.into_iter().flatten(), inside)
    }
}

/// The configuration of [`DMTetParams`], which start as a ball about the origin.
#[derive(Config, Debug)]
pub struct DMTetParamsConfig {
    /// The number of cells along each axis, 2 to 512.
    pub cells: usize,
    /// The length of the cube's edges, scene units.
    #[config(default = 2.0)]
    pub side: f64,
    /// The radius of the ball, scene units.
    #[config(default = 0.5)]
    pub radius: f64,
}

impl DMTetParamsConfig {
    /// Creates the parameters, in the device's default float type.
    ///
    /// # Errors
    /// As [`TetrahedralGrid::new`], or if the radius is not a finite number.
    pub fn init(&self, device: &Device) -> Result<DMTetParams> {
        let grid = TetrahedralGrid::new(self.cells, self.side)?;
        let radius = self.radius;
        Error::unless(
            radius.is_finite(),
            "DMTet",
            "radius",
            radius,
            "a finite number",
        )?;
        let far = |[x, y, z]: [f64; 3]| x.hypot(y).hypot(z) - radius;
        DMTetParams::from_distances(
            grid,
            &grid.positions().into_iter().map(far).collect::<Vec<_>>(),
            device,
        )
    }
}

/// A shape of any topology with trained signed distances and offsets at the nodes of a [`TetrahedralGrid`] (DMTet, Shen et al.
/// 2021).
///
/// Only nodes at the surface have gradients of renders, so a part can shrink to nothing, split, or join another, but no hole
/// opens where the surface is not near. [`TetrahedralGrid::opacity`] opens holes and adds parts;
/// [`loss::eikonal`](crate::loss::eikonal) keeps the values distances.
///
/// ```
/// use softray::modules::DMTetParamsConfig;
/// use softray::prelude::*;
/// let shape = DMTetParamsConfig::new(16).with_radius(0.7).init(&Device::flex().autodiff())?;
/// let mesh: Mesh = shape.mesh()?;
/// assert!(mesh.vertices.is_tracked() && mesh.faces.len() > 500);
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Module)]
pub struct DMTetParams {
    /// Signed distances `[N, N, N]` along x, y and z, scene units, negative inside.
    pub distances: Param<Tensor<3>>,
    /// Offsets of the nodes `[N, N, N, 3]`, 0 at the start ([`TetrahedralGrid::surfaces`]).
    pub offsets: Param<Tensor<4>>,
    #[module(skip)]
    grid: TetrahedralGrid,
}

impl DMTetParams {
    fn from_distances(grid: TetrahedralGrid, distances: &[f64], device: &Device) -> Result<Self> {
        let n = grid.size();
        Ok(Self {
            distances: leaf(distances.to_vec(), [n; 3], device),
            offsets: leaf(vec![0.0; 3 * n.pow(3)], [n, n, n, 3], device),
            grid,
        })
    }

    /// Creates parameters with the signed distances of a closed mesh, in the device's default float type.
    ///
    /// # Errors
    /// As [`signed_distances`].
    pub fn from_mesh(mesh: &TriangleMesh, grid: TetrahedralGrid, device: &Device) -> Result<Self> {
        Self::from_distances(grid, &signed_distances(mesh, &grid.positions())?, device)
    }

    /// Returns the grid.
    pub fn grid(&self) -> TetrahedralGrid {
        self.grid
    }

    /// Returns the surface, in the graph of the parameters.
    ///
    /// # Errors
    /// As [`TetrahedralGrid::surfaces`].
    pub fn mesh(&self) -> Result<Mesh> {
        let (distances, offsets) = (self.distances.val(), self.offsets.val());
        let grids = self
            .grid
            .surfaces(distances.unsqueeze(), Some(offsets.unsqueeze()));
        Ok(grids?.remove(0))
    }
}
