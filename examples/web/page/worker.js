// The renderer. It computes in pieces of a fraction of a second, and reads messages between them.
import init, { Files, Room, Search, View, has_simd } from './softray_web.js';

// Columns and rows: of images that stand still, of those that move, and of derivative images.
const LARGE = [480, 360];
const SMALL = [160, 120];
const FINE = [80, 60];
// Passes over a derivative image, and how many of them are left.
const DERIVATIVE_PASSES = 12;
let left = 0;

let room, view, search;
let moving = { room: false, view: false };
let visible = { room: true, view: false };
let done = { room: false, view: false };
// The next pass is the first one of a new image.
let fresh = { room: true, view: true };
let wake = () => {};

const send = (message, ...buffers) => postMessage(message, buffers);

// Runs work of a number of paths, and reports its time.
function timed(kind, paths, work) {
  const start = performance.now();
  const result = work();
  send({ kind: 'time', of: kind, paths, ms: performance.now() - start });
  return result;
}

function refine(which, picture) {
  const size = moving[which] || fresh[which] ? SMALL : LARGE;
  fresh[which] = false;
  // An error ends it.
  done[which] = true;
  const pixels = timed('images', size[0] * size[1], () => picture.refine(...size));
  if (!pixels) return;
  done[which] = false;
  send({ kind: which, size, pixels }, pixels.buffer);
}

function step() {
  // An error ends it.
  const running = search;
  search = undefined;
  const [x, y, z, loss, index, steps] = timed('steps', Search.paths(), () => running.step());
  const [seen, difference] = [running.seen(), running.difference()];
  send({ kind: 'step', place: [x, y, z], loss, index, steps, seen, difference }, seen.buffer, difference.buffer);
  if (index === steps) running.free();
  else search = running;
}

function derive() {
  left -= 1;
  const values = room.derivatives(...FINE);
  send({ kind: 'derivatives', size: FINE, values, left }, values.buffer);
}

// Work that waits, each kind in its turn. Of a fit two steps count as one piece.
let turn = 0;
function next() {
  const kinds = [
    search && step,
    search && step,
    visible.room && !search && !done.room && (() => refine('room', room)),
    visible.room && !moving.room && left && derive,
    visible.view && !done.view && (() => refine('view', view)),
  ];
  for (let i = 0; i < kinds.length; i++) {
    const work = kinds[turn++ % kinds.length];
    if (work) return work;
  }
}

function place({ place: [x, y, z], azimuth, elevation, moves }) {
  room.set(x, y, z, azimuth, elevation);
  moving.room = moves;
  done.room = false;
  fresh.room = true;
  left = DERIVATIVE_PASSES;
}

const receive = {
  room: place,
  // Follows a fit, with one pass of the picture.
  follow(message) {
    place({ ...message, moves: false });
    refine('room', room);
  },
  search({ start, target }) {
    search?.free();
    search = new Search(new Float64Array(start), new Float64Array(target));
    const pixels = search.target();
    send({ kind: 'target', pixels }, pixels.buffer);
  },
  stop() {
    search?.free();
    search = undefined;
  },
  visible(message) {
    Object.assign(visible, message.which);
  },
  open({ name, files }) {
    const all = new Files();
    for (const [name, bytes] of files) all.add(name, new Uint8Array(bytes));
    let opened;
    try {
      opened = View.open(name, all);
    } catch (error) {
      if (error instanceof WebAssembly.RuntimeError) throw error;
      send({ kind: 'refused', name, message: error.message });
      return;
    }
    view.free();
    view = opened;
    done.view = false;
    fresh.view = true;
    send({ kind: 'opened', name, note: view.note() });
  },
  turn({ right, up, nearer, moves }) {
    view.turn(right, up, nearer);
    moving.view = moves;
    done.view = false;
    fresh.view = true;
  },
  // For tests: an image of its own, with its time.
  measure({ size, samples, bounces }) {
    const start = performance.now();
    const pixels = view.radiance(...size, samples, bounces);
    send({ kind: 'measured', pixels, ms: performance.now() - start });
  },
};

function guarded(work, of = work.name) {
  try {
    work();
  } catch (error) {
    // A trap leaves the memory as it was in the middle of something, so that nothing more can run in it.
    const fatal = error instanceof WebAssembly.RuntimeError;
    send({ kind: 'failed', of, message: `${error.message ?? error}`, fatal });
    if (fatal) close();
  }
}

const waiting = [];
onmessage = ({ data }) => {
  waiting.push(data);
  wake();
};

await init();
guarded(() => {
  room = new Room();
  view = new View();
});
send({ kind: 'ready', simd: has_simd() });
for (;;) {
  while (waiting.length) {
    const message = waiting.shift();
    guarded(() => receive[message.kind](message), message.kind);
  }
  const work = next();
  if (work) {
    guarded(work);
    await new Promise((resolve) => setTimeout(resolve));
  } else {
    await new Promise((resolve) => (wake = resolve));
  }
}
