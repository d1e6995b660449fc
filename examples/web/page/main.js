// The page: what is dragged and pressed goes to the worker, and its pictures to the canvases.
const $ = (id) => document.getElementById(id);
const clamp = (x, low, high) => Math.min(high, Math.max(low, x));

// As in src/room.rs.
const MIDDLE = [0, 1, 0];
const DISTANCE = 6.4;
const FIELD_OF_VIEW = 40;
const ASPECT = 4 / 3;

const state = {
  place: [1.5, 1.8, -0.4],
  azimuth: 28,
  elevation: 24,
  target: [-0.15, 1.95, 0.1],
  way: [],
  losses: [],
  fitting: false,
  by: 0,
};
let worker;
let ready = false;
let following = false;

// ---- the camera of the room ----

const sum = (a, b, s = 1) => a.map((x, i) => x + s * b[i]);
const dot = (a, b) => a.reduce((t, x, i) => t + x * b[i], 0);

function camera() {
  const [a, e] = [state.azimuth, state.elevation].map((d) => (d * Math.PI) / 180);
  const back = [Math.cos(e) * Math.sin(a), Math.sin(e), Math.cos(e) * Math.cos(a)];
  const right = [Math.cos(a), 0, -Math.sin(a)];
  const up = [-Math.sin(e) * Math.sin(a), Math.cos(e), -Math.sin(e) * Math.cos(a)];
  const slope = Math.tan((FIELD_OF_VIEW * Math.PI) / 360);
  return { eye: sum(MIDDLE, back, DISTANCE), back, right, up, slope };
}

// A point of the room on the canvas, in [0, 1]², and the size of a unit there over the height.
function project(point) {
  const c = camera();
  const to = sum(point, c.eye, -1);
  const depth = -dot(to, c.back);
  const x = dot(to, c.right) / (depth * c.slope * ASPECT);
  const y = dot(to, c.up) / (depth * c.slope);
  return [0.5 + x / 2, 0.5 - y / 2, 1 / (2 * depth * c.slope)];
}

// The point at a height that is seen at a place of the canvas.
function lift([x, y], height) {
  const c = camera();
  const [u, v] = [(2 * x - 1) * c.slope * ASPECT, (1 - 2 * y) * c.slope];
  const ray = sum(sum(c.right.map((r) => r * u), c.up, v), c.back, -1);
  const t = (height - c.eye[1]) / ray[1];
  return t > 0 && t < 30 ? sum(c.eye, ray, t) : undefined;
}

// ---- pictures ----

function paint(id, [width, height], pixels) {
  const canvas = $(id);
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  canvas.getContext('2d').putImageData(new ImageData(new Uint8ClampedArray(pixels.buffer), width, height), 0, 0);
}

// Signed values as colors: orange above 0, blue below.
function signed(values, scale) {
  const pixels = new Uint8ClampedArray(4 * values.length);
  values.forEach((value, i) => {
    const v = Math.sign(value) * Math.sqrt(Math.min(1, Math.abs(value) / scale));
    const full = v > 0 ? [255, 154, 61] : [74, 163, 255];
    for (let c = 0; c < 3; c++) pixels[4 * i + c] = 14 + (full[c] - 14) * Math.abs(v);
    pixels[4 * i + 3] = 255;
  });
  return pixels;
}

// Images by x, y and z of the ring and by the camera's turn, one after the other.
let derivatives;
function paintDerivatives() {
  if (!derivatives) return;
  const { size, values } = derivatives;
  const count = size[0] * size[1];
  const own = values.subarray(count * state.by, count * (state.by + 1));
  const sizes = Float32Array.from(own, Math.abs).filter((v) => v > 0).sort();
  paint('derivative', size, signed(own, sizes[Math.floor(0.97 * sizes.length)] || 1));
}

function paintOverlay() {
  const canvas = $('overlay');
  const ratio = window.devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth * ratio, canvas.clientHeight * ratio];
  Object.assign(canvas, { width, height });
  const context = canvas.getContext('2d');
  const at = (point) => {
    const [x, y, scale] = project(point);
    return [x * width, y * height, scale * height];
  };
  context.lineWidth = 2 * ratio;
  const shown = state.way.length > 0;
  if (shown) {
    // The ring where it is to be found, and a line from there to the floor.
    const [x, y, unit] = at(state.target);
    const [fx, fy] = at([state.target[0], 0, state.target[2]]);
    context.strokeStyle = '#7ee2a8';
    context.setLineDash([4 * ratio, 4 * ratio]);
    context.beginPath();
    context.arc(x, y, 0.2 * unit, 0, 7);
    context.moveTo(x, y + 0.2 * unit);
    context.lineTo(fx, fy);
    context.stroke();
    context.setLineDash([]);
    // The way of the fit, and its shadow on the floor.
    for (const [color, point] of [['#00000080', ([x, , z]) => [x, 0, z]], ['#ff9a3d', (p) => p]]) {
      context.strokeStyle = color;
      context.beginPath();
      state.way.forEach((p, i) => {
        const [x, y] = at(point(p));
        if (i) context.lineTo(x, y);
        else context.moveTo(x, y);
      });
      context.stroke();
    }
    const [lx, ly] = at(state.way.at(-1));
    context.fillStyle = '#fff';
    context.beginPath();
    context.arc(lx, ly, 3.5 * ratio, 0, 7);
    context.fill();
  }
}

function paintLoss() {
  const canvas = $('loss');
  const context = canvas.getContext('2d');
  const { width, height } = canvas;
  context.clearRect(0, 0, width, height);
  // Means over some steps: the loss of a step is noisy, and may be below 0.
  const smooth = state.losses.map((_, i, all) => {
    const near = all.slice(Math.max(0, i - 11), i + 1);
    return Math.log10(Math.max(1e-6, near.reduce((a, b) => a + b) / near.length));
  });
  if (smooth.length < 2) return;
  const [low, high] = [Math.min(...smooth), Math.max(...smooth) + 0.1];
  const margin = 16;
  const x = (i) => margin + (i / Math.max(1, state.steps - 1)) * (width - 2 * margin);
  const y = (v) => margin + ((high - v) / (high - low)) * (height - 2 * margin);
  context.fillStyle = '#a3a7b0';
  context.strokeStyle = '#2a2f39';
  context.font = '17px system-ui, sans-serif';
  for (let power = Math.ceil(low); power <= high; power++) {
    context.beginPath();
    context.moveTo(0, y(power));
    context.lineTo(width, y(power));
    context.stroke();
    context.fillText(`1e${power}`, 4, y(power) - 4);
  }
  context.strokeStyle = '#ff9a3d';
  context.lineWidth = 3;
  context.beginPath();
  smooth.forEach((v, i) => (i ? context.lineTo(x(i), y(v)) : context.moveTo(x(i), y(v))));
  context.stroke();
}

// ---- messages ----

const send = (message) => ready && worker.postMessage(message);

function sendRoom(kind, moves) {
  const { place, azimuth, elevation } = state;
  delete $('derivative').dataset.left;
  send({ kind, place, azimuth, elevation, moves });
  paintOverlay();
}

const times = {};
function count({ of, paths, ms }) {
  const t = (times[of] ??= { paths: 0, ms: 0 });
  // The newest seconds count.
  const kept = t.ms > 2000 ? 0.5 : 1;
  t.paths = t.paths * kept + paths;
  t.ms = t.ms * kept + ms;
}

const perSecond = (t) => {
  const digits = 10 ** Math.max(0, Math.floor(Math.log10((1000 * t.paths) / t.ms)) - 1);
  return (Math.round((1000 * t.paths) / t.ms / digits) * digits).toLocaleString('en');
};

let where = '';
function showSpeed() {
  if (!ready) return;
  const { images, steps } = times;
  const parts = [where];
  if (images) parts.push(`${perSecond(images)} paths a second`);
  if (steps) parts.push(`${perSecond(steps)} with derivatives`);
  $('speed').textContent = parts.join(' · ');
}
setInterval(showSpeed, 500);

const distance = () => Math.hypot(...sum(state.place, state.target, -1));

const show = {
  ready({ simd }) {
    ready = true;
    where = `WebAssembly${simd ? ' with SIMD' : ''}, one worker thread`;
    for (const id of ['fit', 'other']) $(id).disabled = false;
    send({ kind: 'visible', which: seen });
    sendRoom('room', false);
  },
  room({ size, pixels }) {
    following = false;
    paint('room', size, pixels);
    if (!document.body.dataset.painted) {
      document.body.dataset.painted = Math.round(performance.now());
      // Without a visitor the page shows what it does.
      find();
    }
  },
  view({ size, pixels }) {
    paint('view', size, pixels);
    $('view').dataset.passes = Number($('view').dataset.passes ?? 0) + 1;
  },
  target({ pixels }) {
    paint('target', [32, 32], pixels);
  },
  step({ place, loss, index, steps, seen, difference }) {
    if (!state.fitting) return;
    Object.assign(state, { place, steps });
    state.way.push(place);
    state.losses.push(loss);
    paint('seen', [32, 32], seen);
    paint('difference', [32, 32], signed(difference, 0.1));
    $('height').value = place[1];
    paintLoss();
    paintOverlay();
    const seconds = ((performance.now() - state.start) / 1000).toFixed(1);
    $('state').textContent = `step ${index} of ${steps}, ${seconds} s: ${distance().toFixed(3)} from the place`;
    if (index === steps) {
      end();
      $('state').dataset.seconds = seconds;
      $('state').dataset.distance = distance();
      $('state').textContent = `Found in ${seconds} s and ${steps} steps: ${distance().toFixed(3)} from the place, of ${state.away.toFixed(1)} at the start. Drag the ring away, and try again.`;
      sendRoom('room', false);
    } else if (index % 4 === 0 && !following) {
      following = true;
      sendRoom('follow');
    }
  },
  derivatives({ size, values, left }) {
    derivatives = { size, values };
    $('derivative').dataset.left = left;
    paintDerivatives();
  },
  opened({ name, note }) {
    $('name').className = '';
    $('name').textContent = note ? `${name}: ${note}` : name;
    $('view').dataset.passes = 0;
  },
  refused({ message }) {
    $('name').className = 'wrong';
    $('name').textContent = message;
  },
  measured(message) {
    measured?.(message);
  },
  time: count,
  failed({ of, message, fatal }) {
    $('failure').textContent = fatal ? `The renderer stopped and was started again: ${message}.` : message;
    $('failure').hidden = false;
    if (fatal || of === 'search' || of === 'step') end();
    // A page that has shown nothing would start again without end.
    if (fatal && document.body.dataset.painted) begin();
  },
};

function begin() {
  worker?.terminate();
  ready = false;
  for (const id of ['fit', 'other']) $(id).disabled = true;
  following = false;
  worker = new Worker(new URL('worker.js', import.meta.url), { type: 'module' });
  worker.onmessage = ({ data }) => show[data.kind](data);
  worker.onerror = (event) => {
    $('failure').textContent = `The renderer can't start: ${event.message ?? 'this browser lacks module workers or WebAssembly SIMD'}.`;
    $('failure').hidden = false;
  };
}

// For tests: the linear values of an image of the view, and the milliseconds that it took.
let measured;
window.measure = (size, samples, bounces) =>
  new Promise((resolve) => {
    measured = ({ pixels, ms }) => resolve({ pixels: [...pixels], ms });
    send({ kind: 'measure', size, samples, bounces });
  });

// ---- the fit ----

function find() {
  state.away = distance();
  Object.assign(state, { fitting: true, way: [[...state.place]], losses: [], start: performance.now() });
  $('fit').textContent = 'Stop';
  delete $('state').dataset.distance;
  $('failure').hidden = true;
  send({ kind: 'search', start: state.place, target: state.target });
}

function end() {
  state.fitting = false;
  $('fit').textContent = 'Find the place';
  send({ kind: 'stop' });
}

$('fit').onclick = () => {
  if (!state.fitting) {
    find();
    return;
  }
  end();
  $('state').textContent = 'Stopped.';
  sendRoom('room', false);
};

$('other').onclick = () => {
  const random = (low, high) => low + Math.random() * (high - low);
  state.target = [random(-0.7, 0.7), random(1.75, 2.2), random(-0.5, 0.7)];
  find();
};

// ---- dragging ----

// Calls a function with the places of a drag, each in [0, 1]² of the element, and whether it goes on. Two fingers pinch
// instead, by the ratio of their distances.
function onDrag(element, begin, move, pinch) {
  const place = (event) => {
    const box = element.getBoundingClientRect();
    return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
  };
  const fingers = new Map();
  const apart = () => {
    const [a, b] = [...fingers.values()];
    return Math.hypot(a[0] - b[0], a[1] - b[1]);
  };
  element.addEventListener('pointerdown', (event) => {
    element.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, place(event));
    if (fingers.size === 1) begin(place(event));
  });
  element.addEventListener('pointermove', (event) => {
    const last = fingers.get(event.pointerId);
    if (!last) return;
    const [now, before] = [place(event), fingers.size > 1 && apart()];
    fingers.set(event.pointerId, now);
    if (before) pinch?.(before / Math.max(1e-3, apart()));
    else move(now, [now[0] - last[0], now[1] - last[1]], true);
  });
  const stop = (event) => {
    const last = fingers.get(event.pointerId);
    if (last && fingers.size === 1) move(last, [0, 0], false);
    fingers.delete(event.pointerId);
  };
  element.addEventListener('pointerup', stop);
  element.addEventListener('pointercancel', stop);
}

let grabbed;
onDrag(
  $('room'),
  ([x, y]) => {
    const [rx, ry, unit] = project(state.place);
    const isRing = Math.hypot((x - rx) * ASPECT, y - ry) < 0.75 * unit;
    const at = isRing && lift([x, y], state.place[1]);
    grabbed = at ? sum(state.place, at, -1) : undefined;
    if (state.fitting && isRing) end();
  },
  (now, [dx, dy], moves) => {
    if (grabbed) {
      const at = lift(now, state.place[1]);
      if (at) state.place = sum(at, grabbed).map((x, i) => (i === 1 ? state.place[1] : clamp(x, -2.2, 2.2)));
      state.way = [];
    } else {
      state.azimuth -= 140 * dx;
      state.elevation = clamp(state.elevation + 90 * dy, 4, 80);
    }
    if (!state.fitting) sendRoom('room', moves);
    else paintOverlay();
  },
);

$('height').oninput = () => {
  if (state.fitting) end();
  state.place[1] = Number($('height').value);
  state.way = [];
  sendRoom('room', true);
};
$('height').onchange = () => sendRoom('room', false);

for (const input of document.getElementsByName('by')) {
  input.onchange = () => {
    state.by = Number(input.value);
    paintDerivatives();
  };
}

let still;
const nearer = (factor) => {
  send({ kind: 'turn', right: 0, up: 0, nearer: factor, moves: true });
  clearTimeout(still);
  still = setTimeout(() => send({ kind: 'turn', right: 0, up: 0, nearer: 1, moves: false }), 200);
};
const turn = (_, [dx, dy], moves) => send({ kind: 'turn', right: 200 * dx, up: 140 * dy, nearer: 1, moves });
onDrag($('view'), () => {}, turn, nearer);
$('view').addEventListener('wheel', (event) => {
  event.preventDefault();
  nearer(Math.exp(clamp(event.deltaY, -200, 200) / 600));
}, { passive: false });

// ---- files ----

const SCENES = ['json', 'gltf', 'glb', 'obj', 'ply'];
const ending = (name) => name.split('.').pop().toLowerCase();

async function open(files) {
  const rank = (file) => SCENES.indexOf(ending(file.name));
  const scenes = files.filter((file) => rank(file) >= 0).sort((a, b) => rank(a) - rank(b));
  if (!scenes.length) {
    show.refused({ message: `${files[0]?.name ?? 'what was dropped'}: it is no scene, expected one of .${SCENES.join(', .')}` });
    return;
  }
  $('name').className = '';
  $('name').textContent = `${scenes[0].name} is being read.`;
  const contents = await Promise.all(files.map(async (file) => [file.name, await file.arrayBuffer()]));
  worker.postMessage({ kind: 'open', name: scenes[0].name, files: contents }, contents.map(([, bytes]) => bytes));
}

$('files').onchange = () => open([...$('files').files]);
for (const kind of ['dragover', 'dragleave', 'drop']) {
  addEventListener(kind, (event) => {
    event.preventDefault();
    $('drop').classList.toggle('over', kind === 'dragover');
    if (kind === 'drop' && event.dataTransfer.files.length) open([...event.dataTransfer.files]);
  });
}

// ---- what is in view ----

const seen = { room: true, view: false };
const observer = new IntersectionObserver((entries) => {
  for (const { target, isIntersecting } of entries) seen[target.id] = isIntersecting;
  send({ kind: 'visible', which: seen });
});
observer.observe($('room'));
observer.observe($('view'));
addEventListener('resize', paintOverlay);
paintOverlay();
begin();
