// Tests of the page in headless Chromium, beside the native crate: `node test.mjs PAGE MODULES SCENE PFM NATIVE`, called
// by .ci/browser.
//
// PAGE is the folder of the page, MODULES the folder of playwright-core, SCENE the folder of a scene.json with its files,
// PFM the native image of it, and NATIVE a command that renders it on one thread and prints its seconds. With PICTURES
// set, screenshots are written to that folder.
import assert from 'node:assert/strict';
import { execSync } from 'node:child_process';
import { readdirSync, readFileSync, statSync } from 'node:fs';
import { createServer } from 'node:http';
import { createRequire } from 'node:module';
import { basename, extname, join } from 'node:path';
import { brotliCompressSync, gzipSync } from 'node:zlib';

const [page_folder, modules, scene, pfm, native] = process.argv.slice(2);
const { chromium } = createRequire(join(modules, 'x.js'))('playwright-core');

const TYPES = { '.html': 'text/html', '.css': 'text/css', '.js': 'text/javascript', '.wasm': 'application/wasm' };
let requests = 0;
// The memory that the renderer may have, in WebAssembly's pages of 64 KiB, if it is less than 4 GiB.
let pages;
const server = createServer((request, response) => {
  requests += 1;
  const path = join(page_folder, basename(request.url === '/' ? 'index.html' : request.url));
  response.setHeader('Content-Type', TYPES[extname(path)] ?? 'application/octet-stream');
  const bytes = readFileSync(path);
  response.end(pages && extname(path) === '.wasm' ? limited(bytes, pages) : bytes);
});
await new Promise((resolve) => server.listen(0, '127.0.0.1', resolve));
const address = `http://127.0.0.1:${server.address().port}/`;

const browser = await chromium.launch({ executablePath: process.env.CHROMIUM ?? '/usr/bin/chromium', args: ['--no-sandbox'] });

// A WebAssembly module with a maximum of its memory.
function limited(module, pages) {
  const number = (n) => (n < 128 ? [n] : [(n & 127) | 128, ...number(n >> 7)]);
  let at = 8;
  for (;;) {
    const id = module[at];
    let [length, shift, start] = [0, 0, at + 1];
    do {
      length |= (module[start] & 127) << shift;
      shift += 7;
    } while (module[start++] & 128);
    if (id === 5) {
      // One memory, without a maximum: then its minimum follows.
      assert.deepEqual([...module.subarray(start, start + 2)], [1, 0]);
      const memory = [1, 1, ...module.subarray(start + 2, start + length), ...number(pages)];
      const section = Buffer.from([5, ...number(memory.length), ...memory]);
      return Buffer.concat([module.subarray(0, at), section, module.subarray(start + length)]);
    }
    at = start + length;
  }
}

// A page whose errors are collected.
async function open(options) {
  const page = await browser.newPage(options);
  const errors = [];
  page.on('pageerror', (error) => errors.push(String(error)));
  page.on('console', (message) => ['error', 'warning'].includes(message.type()) && errors.push(message.text()));
  await page.goto(address);
  return { page, errors };
}

const text = (page, id) => page.locator(id).textContent();

// Drops files onto the page, as a visitor does.
async function drop(page, files) {
  const all = files.map(([name, bytes]) => [name, Buffer.from(bytes).toString('base64')]);
  await page.evaluate((all) => {
    const dataTransfer = new DataTransfer();
    for (const [name, base64] of all) {
      dataTransfer.items.add(new File([Uint8Array.from(atob(base64), (c) => c.charCodeAt(0))], name));
    }
    dispatchEvent(new DragEvent('drop', { dataTransfer, cancelable: true }));
  }, all);
}

// A .glb with a triangle.
function triangle() {
  const binary = Buffer.from(new Float32Array([0, 0, 0, 1, 0, 0, 0, 1, 0]).buffer);
  let json = JSON.stringify({
    asset: { version: '2.0' }, scene: 0, scenes: [{ nodes: [0] }], nodes: [{ mesh: 0 }],
    meshes: [{ primitives: [{ attributes: { POSITION: 0 } }] }],
    accessors: [{ bufferView: 0, componentType: 5126, count: 3, type: 'VEC3', min: [0, 0, 0], max: [1, 1, 0] }],
    bufferViews: [{ buffer: 0, byteLength: 36 }], buffers: [{ byteLength: 36 }],
  });
  json = json.padEnd(4 * Math.ceil(json.length / 4));
  const words = (...values) => Buffer.from(new Uint32Array(values).buffer);
  const chunks = [words(json.length, 0x4e4f534a), Buffer.from(json), words(36, 0x004e4942), binary];
  const body = Buffer.concat(chunks);
  return Buffer.concat([words(0x46546c67, 2, 12 + body.length), body]);
}

// The colors of a canvas: the mean of each channel, and how many colors there are.
const colors = (page, id) =>
  page.locator(id).evaluate((canvas) => {
    const copy = Object.assign(document.createElement('canvas'), { width: canvas.width, height: canvas.height });
    const context = copy.getContext('2d', { willReadFrequently: true });
    context.drawImage(canvas, 0, 0);
    const { data } = context.getImageData(0, 0, copy.width, copy.height);
    const all = new Set();
    const mean = [0, 0, 0];
    for (let i = 0; i < data.length; i += 4) {
      all.add((data[i] << 16) | (data[i + 1] << 8) | data[i + 2]);
      for (let c = 0; c < 3; c++) mean[c] += (4 * data[i + c]) / data.length;
    }
    return { mean, count: all.size };
  });

async function picture(page, name, ...of) {
  if (process.env.PICTURES) await page.screenshot({ path: join(process.env.PICTURES, name), fullPage: true, ...of });
}

// The linear values of a PFM, from the top row down.
function read(path) {
  const bytes = readFileSync(path);
  const header = bytes.toString('latin1', 0, 64).split('\n');
  const [width, height] = header[1].split(' ').map(Number);
  const start = header.slice(0, 3).join('\n').length + 1;
  const rows = Array.from({ length: height }, (_, y) =>
    Array.from({ length: 3 * width }, (_, i) => bytes.readFloatLE(start + 4 * (3 * width * (height - 1 - y) + i))));
  return { width, height, values: rows.flat() };
}

const tests = {
  async 'the page is small'() {
    const files = readdirSync(page_folder).map((name) => readFileSync(join(page_folder, name)));
    const of = (compress) => files.reduce((sum, bytes) => sum + compress(bytes).length, 0);
    const [gzip, brotli] = [of(gzipSync), of(brotliCompressSync)];
    console.log(`  ${gzip} bytes by gzip, ${brotli} by brotli`);
    assert.ok(gzip < 2e6);
  },

  async 'it loads, shows its first image, and finds the place'() {
    const { page, errors } = await open({ viewport: { width: 1120, height: 900 } });
    const painted = page.locator('body[data-painted]');
    await painted.waitFor({ state: 'attached', timeout: 60_000 });
    console.log(`  first image after ${await painted.getAttribute('data-painted')} ms`);
    // It begins to search on its own.
    const state = page.locator('#state[data-distance]');
    await page.waitForFunction(() => document.querySelector('#state').textContent.startsWith('step 40'), null, { timeout: 60_000 });
    await picture(page, 'search.png');
    await state.waitFor({ timeout: 120_000 });
    const distance = Number(await state.getAttribute('data-distance'));
    console.log(`  found in ${await state.getAttribute('data-seconds')} s: ${distance.toFixed(3)} from the place`);
    assert.ok(distance < 0.1, `${distance} from the place`);
    // The derivative image: shadows move to both sides.
    await page.locator('#derivative[data-left="0"]').waitFor({ timeout: 120_000 });
    const { mean, count } = await colors(page, '#derivative');
    assert.ok(count > 50 && mean[0] > 16 && mean[2] > 16, `${mean}, ${count} colors`);
    await picture(page, 'derivative.png');
    console.log(`  ${await text(page, '#speed')}`);
    assert.deepEqual(errors, []);
    await page.close();
  },

  async 'a visitor drags the ring, and the page answers while it computes'() {
    const { page, errors } = await open({ viewport: { width: 1120, height: 900 } });
    await page.waitForFunction(() => document.querySelector('#state').textContent.startsWith('step 4'), null, { timeout: 60_000 });
    const box = await page.locator('#room').boundingBox();
    const at = (x, y) => [box.x + x * box.width, box.y + y * box.height];
    // The camera turns while the fit runs.
    const before = await page.locator('#overlay').screenshot();
    await page.mouse.move(...at(0.05, 0.9));
    await page.mouse.down();
    await page.mouse.move(...at(0.3, 0.9), { steps: 4 });
    await page.mouse.up();
    assert.notDeepEqual(await page.locator('#overlay').screenshot(), before);
    const start = performance.now();
    await page.getByRole('button', { name: 'Stop' }).click();
    await page.getByText('Stopped.').waitFor();
    const answered = performance.now() - start;
    console.log(`  a click is answered after ${answered.toFixed(0)} ms`);
    assert.ok(answered < 1000);
    await page.getByLabel("the camera's turn").check();
    await page.locator('#derivative[data-left="0"]').waitFor({ timeout: 120_000 });
    const { count } = await colors(page, '#derivative');
    assert.ok(count > 50, `${count} colors`);
    assert.deepEqual(errors, []);
    await page.close();
  },

  async 'files are rendered, and damaged ones get a sentence'() {
    const { page, errors } = await open({ viewport: { width: 1120, height: 900 } });
    await page.locator('#view').scrollIntoViewIfNeeded();
    const refined = () => page.waitForFunction(() => Number(document.querySelector('#view').dataset.passes) >= 4, null, { timeout: 60_000 });
    await refined();
    const box = await colors(page, '#view');
    const named = async (part) => page.waitForFunction((part) => document.querySelector('#name').textContent.includes(part), part, { timeout: 60_000 });

    await drop(page, [['triangle.glb', triangle()]]);
    await named('triangle.glb: no light in the file: a white environment');
    await refined();
    const shown = await colors(page, '#view');
    assert.ok(shown.count > 3 && Math.abs(shown.mean[0] - box.mean[0]) > 5, `${shown.mean}, ${shown.count} colors`);
    await page.locator('#view').hover();
    await page.mouse.down();
    await page.mouse.move(500, 300, { steps: 3 });
    await page.mouse.up();
    await picture(page, 'file.png');

    for (const [files, part] of [
      [[['cut.glb', triangle().subarray(0, 40)]], 'cut.glb: its chunk JSON has'],
      [[['bad.obj', 'v 0 0 0\nf 1 2 3\n']], 'bad.obj: line 2: f 2: v index 2 is out of range'],
      [[['notes.txt', 'no scene']], 'notes.txt: it is no scene, expected one of'],
    ]) {
      await drop(page, files);
      await named(part);
    }
    // What was there before is still shown, and works.
    await drop(page, [['triangle.glb', triangle()]]);
    await named('triangle.glb');
    await refined();

    const files = readdirSync(scene).filter((name) => /\.(json|obj|mtl)$/.test(name));
    await drop(page, files.map((name) => [name, readFileSync(join(scene, name))]));
    await named('scene.json');
    const wanted = read(pfm);
    const { pixels } = await page.evaluate(([size, samples, bounces]) => window.measure(size, samples, bounces), [[wanted.width, wanted.height], 64, 3]);
    const differences = wanted.values.map((v, i) => Math.abs(v - pixels[i]));
    const mean = differences.reduce((a, b) => a + b) / differences.length;
    const most = differences.reduce((a, b) => Math.max(a, b));
    const apart = differences.filter((d) => d > 1e-5).length;
    console.log(`  beside the native image: ${mean.toExponential(1)} in the mean, ${most.toExponential(1)} at most, ${apart} of ${differences.length} values over 1e-5`);
    assert.ok(mean < 1e-5);

    // Times of both at about the same time, as ratios: the machine may have other work.
    const ratios = [];
    for (let i = 0; i < 3; i++) {
      const { ms } = await page.evaluate(() => window.measure([256, 256], 64, 3));
      const output = execSync(native, { encoding: 'utf8' });
      const seconds = Number(/seconds ([\d.]+)/.exec(output)[1]);
      ratios.push((1000 * seconds) / ms);
      console.log(`  ${((65_536 * 64) / ms / 1000).toFixed(3)} M paths/s in the page, ${((65_536 * 64) / seconds / 1e6).toFixed(3)} M native on one thread`);
    }
    console.log(`  page over native: ${ratios.map((r) => r.toFixed(2)).join(', ')}`);
    assert.deepEqual(errors, []);
    await page.close();
  },

  async 'an image that is too large is an error, after which the page goes on'() {
    const { page, errors } = await open({ viewport: { width: 1120, height: 900 } });
    await page.locator('body[data-painted]').waitFor({ state: 'attached', timeout: 60_000 });
    await page.evaluate(() => void window.measure([40000, 40000], 1, 0));
    await page.getByText('images within 4.3 GB').waitFor({ timeout: 60_000 });
    assert.deepEqual(errors, []);
    const { pixels } = await page.evaluate(() => window.measure([8, 8], 1, 0));
    assert.equal(pixels.length, 192);
    await page.close();
  },

  async 'a renderer that runs out of memory is started again'() {
    pages = 128 << 4;
    const { page, errors } = await open({ viewport: { width: 1120, height: 900 } });
    await page.locator('body[data-painted]').waitFor({ state: 'attached', timeout: 60_000 });
    // A file of 256 MiB, where the renderer may have 128.
    await page.evaluate(() => {
      const dataTransfer = new DataTransfer();
      dataTransfer.items.add(new File([new Uint8Array(1 << 28)], 'large.glb'));
      dispatchEvent(new DragEvent('drop', { dataTransfer, cancelable: true }));
    });
    await page.getByText('The renderer stopped and was started again').waitFor({ timeout: 60_000 });
    console.log(`  ${await text(page, '#failure')}`);
    // All of it works again.
    await page.locator('#fit:enabled').waitFor({ timeout: 60_000 });
    const { pixels } = await page.evaluate(() => window.measure([8, 8], 1, 0));
    assert.equal(pixels.length, 192);
    await page.getByRole('button', { name: 'Find the place' }).click();
    await page.waitForFunction(() => document.querySelector('#state').textContent.startsWith('step 4'), null, { timeout: 60_000 });
    assert.deepEqual(errors, []);
    await page.close();
    pages = undefined;
  },

  async 'a phone shows all of it, and nothing is fetched after it is loaded'() {
    const { page, errors } = await open({ viewport: { width: 390, height: 844 }, deviceScaleFactor: 2, hasTouch: true, isMobile: true });
    await page.locator('body[data-painted]').waitFor({ state: 'attached', timeout: 60_000 });
    const width = await page.evaluate(() => document.documentElement.scrollWidth);
    assert.ok(width <= 390, `${width} pixels wide`);
    const now = requests;
    await page.context().setOffline(true);
    await page.waitForFunction(() => document.querySelector('#state').textContent.startsWith('step 20'), null, { timeout: 60_000 });
    await picture(page, 'phone.png');
    assert.equal(requests, now);
    assert.deepEqual(errors, []);
    await page.close();
  },
};

let failed = 0;
for (const [name, test] of Object.entries(tests)) {
  console.log(name);
  try {
    await test();
  } catch (error) {
    failed += 1;
    console.log(`  FAILED: ${error.stack}`);
  }
}
await browser.close();
server.close();
console.log(failed ? `${failed} failed` : 'all passed');
process.exit(failed ? 1 : 0);
