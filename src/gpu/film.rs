//! Jumps of the image at edges that the camera sees: the table of the films of views, the pieces of edges on them, and
//! the kernel that samples them, with one thread per sample.

use softray_kernels::cube::*;

use super::camera::{Beginning, camera};
use super::hit::{Memory, Ray, trace};
use super::job::{Job, Views};
use super::jumps::light_beside;
use super::loss::Loss;
use super::placed::ViewPlaces;
use super::sums::{Adding, of_channel};
use softray_kernels::model::camera::{Camera, CameraRay};
use softray_kernels::model::choice::is_positive;
use softray_kernels::model::film::{BLOCK, DrawnPiece, cell_at, draw_piece, samples_of_film};
use softray_kernels::model::numbers::is_nonzero;
use softray_kernels::model::segment::OnSegment;
use softray_kernels::sampling::{Dimensions, LENGTH};
use softray_kernels::trace::{
    Exposure, FilmPiece, FilmPoint, HEADER, HeaderWord, NO_PIXEL, NONE, OF_CONES, OF_SLOT, ON_FILM,
    Scene, Seen, Sums, exposure, film_point, hides, piece_of_slot, sampler,
};

/// Number of values of the piece of an edge in a slot: its first and last λ, its weight by how much may jump there, and
/// its cell of the film. The weight is later replaced by a running sum within its block. The cell is a whole number,
/// which f32 represents up to [`WHOLE`]. Running sums over blocks follow all pieces.
pub(super) const OF_PIECE: u32 = 4;
pub(super) const WHOLE: u32 = 16_777_216;

/// Words of the table for each view: the maximum number of samples of the views up to and including this one, the
/// maximum number of its own samples, its first piece, the end of its pieces (exclusive), the number of blocks of the
/// views up to and including this one, and the bits of the pixel filter's radius. Kernels then write the bits of the
/// sum of all weights, and the number of the view's samples.
const SAMPLES_END: usize = 0;
pub(super) const MAX_SAMPLES: usize = 1;
pub(super) const FIRST_PIECE: usize = 2;
pub(super) const PAST_PIECE: usize = 3;
pub(super) const BLOCKS: usize = 4;
pub(super) const RADIUS: usize = 5;
pub(super) const TOTAL: usize = 6;
pub(super) const SAMPLES: usize = 7;
pub(super) const OF_FILM: u32 = 8;

/// The films of views.
#[derive(Default)]
pub(crate) struct Films {
    /// The number of slots for pieces of edges in all views.
    pub(super) count: u32,
    /// The table, then the row of each pixel if only listed pixels are rendered.
    pub(super) table: Vec<u32>,
    /// The maximum number of samples of all views, and the number of blocks.
    pub(super) samples: u32,
    pub(super) blocks: u32,
}

impl Films {
    /// Creates the table for the views of a job.
    pub fn new(views: &[ViewPlaces], job: &Job) -> Self {
        let mut films = Self::default();
        // Limited, so that u32 can number the samples of all views.
        let most = u32::MAX / 2 / views.len().max(1) as u32;
        let samples = samples_of_film(job.of_view as u32, job.samples).min(most);
        let headers = job.views.buffers.header().chunks_exact(HEADER);
        let mut size = 0;
        for (&(view, ..), header) in views.iter().zip(headers) {
            size = (view.settings.width * view.settings.height) as usize;
            let slots = header[HeaderWord::slot_count as usize];
            let own = if slots == 0 { 0 } else { samples };
            films.samples += own;
            let first = films.count;
            films.count += slots;
            films.blocks += slots.div_ceil(BLOCK);
            films.table.extend([films.samples, own, first, films.count]);
            let radius = view.filter.radius().to_bits();
            films.table.extend([films.blocks, radius, 0, 0]);
        }
        if let Some(pixels) = &job.pixels {
            let first = films.table.len();
            films.table.resize(first + size, u32::MAX);
            for (row, &pixel) in pixels.iter().enumerate() {
                films.table[first + pixel as usize] = row as u32;
            }
        }
        films
    }

    /// Returns the length of the list of pieces.
    pub(super) fn of_pieces(&self) -> usize {
        OF_PIECE as usize * self.count as usize + self.blocks.max(1) as usize
    }
}

/// Makes the piece of an edge in a slot. Slots are numbered over all views.
#[cube]
pub(super) fn make_piece(
    views: &Views,
    films: &[u32],
    pieces: &mut [f32],
    of_views: u32,
    slot: u32,
) {
    let view = view_of(films, of_views, slot, PAST_PIECE);
    let film = (OF_FILM * view) as usize;
    let scene = views.scene(view);
    let c = camera(&scene);
    let radius = f32::from_bits(films[film + RADIUS]);
    let piece: FilmPiece = piece_of_slot(&scene, &c, radius, slot - films[film + FIRST_PIECE]);
    let visible = is_positive(piece.weight);
    let at = (OF_PIECE * slot) as usize;
    pieces[at] = piece.from;
    pieces[at + 1] = piece.to;
    pieces[at + 2] = select(visible, piece.weight, 0.0);
    // The middle of a piece that nothing sees may be any number.
    let x = select(visible, piece.middle.x, 0.0);
    let y = select(visible, piece.middle.y, 0.0);
    pieces[at + 3] = cell_at(x, y, scene.width, scene.height) as f32;
}

/// Returns the view of a sample, piece or block. `word` selects the table's running count of samples, pieces or
/// blocks.
#[cube]
pub(super) fn view_of(table: &[u32], views: u32, number: u32, #[comptime] word: usize) -> u32 {
    let mut low = 0u32;
    let mut high = views - 1;
    while low < high {
        let middle = (low + high) / 2;
        if table[(OF_FILM * middle) as usize + word] <= number {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    low
}

/// Returns the number of blocks of the views before `view`.
#[cube]
pub(super) fn blocks_before(films: &[u32], view: u32) -> u32 {
    let mut before = 0u32;
    if view > 0 {
        before = films[(OF_FILM * (view - 1)) as usize + BLOCKS];
    }
    before
}

/// Returns the row of a film pixel in a view's image, or [`NONE`].
#[cube]
fn row_of(scene: &Scene, places: &[u32], x: f32, y: f32, #[comptime] listed: bool) -> u32 {
    let mut row = NONE.runtime();
    if x >= 0.0 && y >= 0.0 && x < scene.width as f32 && y < scene.height as f32 {
        row = y as u32 * scene.width + x as u32;
        if listed {
            row = places[row as usize];
        }
    }
    row
}

/// The samples of a launch on the films of views: consecutive samples of all views from `first` on. If `spread` is
/// not 0, they are `spread` samples of each view, spread evenly over the view's samples. `count` is the number of
/// pieces.
#[apply(argument!)]
pub(super) struct FilmSamples {
    first: u32,
    threads: u32,
    spread: u32,
    views: u32,
    of_view: u32,
    count: u32,
}

/// A sample on the film of a view, and the total number of samples on that film.
#[apply(record!)]
struct FilmSample {
    view: u32,
    sample: u32,
    total: u32,
}

#[cube]
impl FilmSamples {
    fn of_thread(&self, films: &[u32], thread: u32) -> FilmSample {
        let mut view = view_of(films, self.views, thread, SAMPLES_END);
        if self.spread > 0 {
            view = thread / self.spread.max(1);
        }
        let film = (OF_FILM * view) as usize;
        let total = films[film + SAMPLES];
        let mut sample = thread;
        if self.spread > 0 {
            sample = ((thread % self.spread) as f32 * (total as f32 / self.spread as f32)) as u32;
        } else {
            sample = thread - (films[film + SAMPLES_END] - films[film + MAX_SAMPLES]);
        }
        FilmSample {
            view,
            sample,
            total,
        }
    }
}

/// Adds the derivatives from jumps on the film.
#[cube(launch)]
pub(super) fn film_jumps(
    views: Views,
    samples: FilmSamples,
    pieces: &[f32],
    films: &[u32],
    loss: Loss,
    adding: Adding,
    #[comptime] listed: bool,
) {
    if ABSOLUTE_POS < samples.threads as usize {
        let thread = samples.first + ABSOLUTE_POS as u32;
        let film_sample = samples.of_thread(films, thread);
        let which = film_sample.view;
        let scene = views.scene(which);
        let source = sampler(&scene, ON_FILM).of_one_pixel();
        let mut sample = film_sample.sample;
        // Neighboring threads sample neighboring edges, so that their rays meet the same triangles.
        let mut length = 0u32;
        while length < LENGTH && (2u32 << length) <= film_sample.total {
            length += 1;
        }
        let ordered = samples.spread == 0 && length > 0;
        if ordered && sample >> length < film_sample.total >> length {
            sample = source.in_order(sample, length);
        }
        let places = &films[(OF_FILM * samples.views) as usize..];
        let film_of = (OF_FILM * which) as usize;
        let total = f32::from_bits(films[film_of + TOTAL]);
        let radius = f32::from_bits(films[film_of + RADIUS]);
        if sample < film_sample.total && films[film_of + MAX_SAMPLES] > 0 {
            let numbers = source.stream(0u32, sample);
            let film = numbers.draw(scene.points, Dimensions::film());
            let at: Exposure = exposure(&scene, &numbers);
            let first = films[film_of + FIRST_PIECE];
            let drawn: DrawnPiece = draw_piece(
                pieces,
                OF_PIECE * first + 2,
                OF_PIECE,
                films[film_of + PAST_PIECE] - first,
                pieces,
                OF_PIECE * samples.count + blocks_before(films, which),
                film.x * total,
            );
            let piece = (OF_PIECE * (first + drawn.piece)) as usize;
            let on: OnSegment = drawn.point(pieces[piece], pieces[piece + 1], total, film.y);
            let c = camera(&scene);
            let edge = scene.slots[OF_SLOT * drawn.piece as usize];
            let mut f: FilmPoint = film_point(&scene, &c, edge, on, film_sample.total, &at);
            let mut row = NONE.runtime();
            if drawn.share > 0.0 && f.is_seen {
                f.project(&scene, &c, sample, radius);
                row = row_of(&scene, places, f.film.x, f.film.y, listed);
            }
            if row != NONE {
                let pixel = which * samples.of_view + row;
                let sums = loss.sums(&scene, &adding, thread, pixel);
                let g = loss.of_row(&scene, pixel);
                if is_nonzero(g.size()) {
                    let path = Beginning {
                        numbers,
                        cones: sampler(&scene, OF_CONES).stream(NO_PIXEL, sample),
                        film,
                        time: at.time,
                        // Unused: the path begins beside the edge.
                        ray: CameraRay::default(),
                    };
                    add_film_jump(&scene, &loss, &sums, &c, &mut f, &g, path);
                }
            }
        }
    }
}

/// Adds the derivatives from the jump at a point of an edge, unless an occluder hides the point. `g` is the
/// derivative of the loss with respect to the pixel that sees it.
#[cube]
fn add_film_jump(
    scene: &Scene,
    loss: &Loss,
    sums: &Sums,
    c: &Camera,
    f: &mut FilmPoint,
    g: &Seen,
    path: Beginning,
) {
    let mut memory = Memory::new(scene);
    let time = path.time;
    let p = f.point;
    let approach = f.approach(scene, c, time);
    let ray = Ray {
        origin: f.origin,
        direction: approach.sides.past,
        time,
        limit: f32::MAX,
    };
    let hit = trace(scene, &mut memory, ray, p.faces, false, false, true);
    if !hides(scene, &hit, &p, time) {
        let light = light_beside(scene, &mut memory, path, 0u32, true, &approach, &hit, true);
        let channels = comptime!(loss.outputs.channels(loss.forward));
        #[unroll(channels == 1)]
        for channel in 0..channels {
            let own = loss.of_channel(g, channel);
            f.backward(scene, &of_channel(sums, channel), c, &own, &light, time);
        }
    }
}
