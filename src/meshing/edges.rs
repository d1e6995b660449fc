//! Edges of a mesh and what they connect.

use super::mesh::TriangleMesh;

/// One side of a face: its two vertices in order of their indices, the face, and whether the face passes the edge from
/// the smaller index to the larger.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Side {
    pub ends: [u32; 2],
    pub face: u32,
    pub corner: u8,
    pub forward: bool,
}

/// The sides of all faces, those of the same edge together.
pub(super) fn sides(mesh: &TriangleMesh) -> Vec<Side> {
    let of_face = |(k, f): (usize, &[u32; 3])| {
        let f = *f;
        (0..3).map(move |c| {
            let (a, b) = (f[c], f[(c + 1) % 3]);
            Side {
                ends: [a.min(b), a.max(b)],
                face: k as u32,
                corner: c as u8,
                forward: a < b,
            }
        })
    };
    let mut sides: Vec<Side> = mesh.faces.iter().enumerate().flat_map(of_face).collect();
    sides.sort_unstable();
    sides
}

/// The sides of each edge.
pub(super) fn by_edge(sides: &[Side]) -> impl Iterator<Item = &[Side]> {
    sides.chunk_by(|a, b| a.ends == b.ends)
}

/// Sets of numbers that are joined one pair after the other.
pub(super) struct Sets(Vec<u32>);

impl Sets {
    pub fn new(count: usize) -> Self {
        Self((0..count as u32).collect())
    }

    /// The number that stands for the set of `x`.
    pub fn find(&mut self, mut x: u32) -> u32 {
        while self.0[x as usize] != x {
            let above = self.0[self.0[x as usize] as usize];
            self.0[x as usize] = above;
            x = above;
        }
        x
    }

    pub fn join(&mut self, x: u32, y: u32) {
        let (x, y) = (self.find(x), self.find(y));
        self.0[x.max(y) as usize] = x.min(y);
    }
}

/// The component of each face, numbered in the order of their first faces, and the number of components. Faces that
/// share a vertex are of one component.
pub(super) fn components(mesh: &TriangleMesh) -> (Vec<u32>, usize) {
    let mut sets = Sets::new(mesh.positions.len());
    for f in &mesh.faces {
        sets.join(f[0], f[1]);
        sets.join(f[1], f[2]);
    }
    let mut number = vec![u32::MAX; mesh.positions.len()];
    let mut count = 0;
    let of_face = |f: &[u32; 3]| {
        let at = &mut number[sets.find(f[0]) as usize];
        if *at == u32::MAX {
            *at = count;
            count += 1;
        }
        *at
    };
    let of_faces = mesh.faces.iter().map(of_face).collect();
    (of_faces, count as usize)
}

/// How faces are connected.
#[derive(Clone, Debug, Default)]
pub(super) struct Connectivity {
    /// The number of edges.
    pub edges: usize,
    /// The number of vertices that faces have.
    pub vertices: usize,
    /// Whether each edge has two faces.
    pub closed: bool,
    /// Whether no edge has more than two faces.
    pub edge_manifold: bool,
    /// Whether the faces at each vertex are one fan, connected by edges.
    pub vertex_manifold: bool,
    /// Whether the two faces of each edge pass it in opposite directions.
    pub oriented: bool,
    /// Whether each vertex lies on an edge without exactly two faces, or has several fans.
    pub irregular: Vec<bool>,
}

impl Connectivity {
    pub fn of(mesh: &TriangleMesh) -> Self {
        let sides = sides(mesh);
        let mut found = Self {
            closed: true,
            edge_manifold: true,
            vertex_manifold: true,
            oriented: true,
            irregular: vec![false; mesh.positions.len()],
            ..Self::default()
        };
        let mut fans = Sets::new(3 * mesh.faces.len());
        for edge in by_edge(&sides) {
            found.edges += 1;
            found.closed &= edge.len() == 2;
            found.edge_manifold &= edge.len() <= 2;
            found.oriented &= match edge {
                [a, b] => a.forward != b.forward,
                [_] => true,
                _ => edge.iter().filter(|s| s.forward).count() * 2 == edge.len(),
            };
            if edge.len() != 2 {
                let ends = edge[0].ends;
                ends.iter()
                    .for_each(|&v| found.irregular[v as usize] = true);
            }
            for side in &edge[1..] {
                let corner = |s: &Side, v: u32| {
                    let f = mesh.faces[s.face as usize];
                    let c = f.iter().position(|&u| u == v).unwrap_or(0);
                    3 * s.face + c as u32
                };
                for v in side.ends {
                    fans.join(corner(&edge[0], v), corner(side, v));
                }
            }
        }
        let mut fan = vec![u32::MAX; mesh.positions.len()];
        for (corner, &v) in mesh.faces.iter().flatten().enumerate() {
            let own = fans.find(corner as u32);
            let at = &mut fan[v as usize];
            if *at == u32::MAX {
                *at = own;
                found.vertices += 1;
            } else if *at != own {
                found.vertex_manifold = false;
                found.irregular[v as usize] = true;
            }
        }
        found
    }

    /// Whether the mesh is the surface of a solid body as far as connections decide.
    pub fn is_solid(&self) -> bool {
        self.closed && self.edge_manifold && self.vertex_manifold && self.oriented
    }
}

/// The vertices that share an edge with each vertex.
pub(super) struct Rings {
    starts: Vec<usize>,
    list: Vec<u32>,
}

impl Rings {
    pub fn new(mesh: &TriangleMesh) -> Self {
        let sides = sides(mesh);
        let edges: Vec<[u32; 2]> = by_edge(&sides).map(|edge| edge[0].ends).collect();
        let mut starts = vec![0usize; mesh.positions.len() + 1];
        for &v in edges.iter().flatten() {
            starts[v as usize + 1] += 1;
        }
        for v in 1..starts.len() {
            starts[v] += starts[v - 1];
        }
        let mut next = starts.clone();
        let mut list = vec![0; 2 * edges.len()];
        for [a, b] in edges {
            for (v, other) in [(a, b), (b, a)] {
                list[next[v as usize]] = other;
                next[v as usize] += 1;
            }
        }
        Self { starts, list }
    }

    pub fn of(&self, vertex: u32) -> &[u32] {
        &self.list[self.starts[vertex as usize]..self.starts[vertex as usize + 1]]
    }
}
