// The kernels for GPUs in headless Chromium, whose WebGPU is SwiftShader's, beside those for CPUs in the same page:
// `node webgpu.mjs FOLDER MODULES`, called by `.ci/browser webgpu`. FOLDER holds what wasm-bindgen writes for the feature `webgpu`.
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { createServer } from 'node:http';
import { createRequire } from 'node:module';
import { basename, extname, join } from 'node:path';

const [folder, modules] = process.argv.slice(2);
const { chromium } = createRequire(join(modules, 'x.js'))('playwright-core');

const TYPES = { '.js': 'text/javascript', '.wasm': 'application/wasm' };
const server = createServer((request, response) => {
  const name = basename(request.url);
  response.setHeader('Content-Type', TYPES[extname(name)] ?? 'text/html');
  response.end(extname(name) ? readFileSync(join(folder, name)) : '<!doctype html><link rel="icon" href="data:,">');
});
await new Promise((resolve) => server.listen(0, '127.0.0.1', resolve));

const args = ['--no-sandbox', '--enable-unsafe-webgpu', '--use-webgpu-adapter=swiftshader'];
const browser = await chromium.launch({ executablePath: process.env.CHROMIUM ?? '/usr/bin/chromium', args });
let failed = false;
try {
  const page = await browser.newPage();
  page.on('pageerror', (error) => console.log(`page: ${error}`));
  page.on('console', (message) => console.log(`console: ${message.text()}`));
  await page.goto(`http://127.0.0.1:${server.address().port}/`);
  const { cpu, gpu, by, ms } = await page.evaluate(async () => {
    const softray = await import('/softray_web.js');
    await softray.default();
    const [width, height, samples] = [24, 20, 4];
    const cpu = [...new softray.View().radiance(width, height, samples, 1)];
    const start = performance.now();
    const all = [...(await softray.on_gpu(width, height, samples))];
    const ms = performance.now() - start;
    return { cpu, gpu: all.slice(0, cpu.length), by: all.slice(cpu.length), ms };
  });
  const most = cpu.reduce((most, v, i) => Math.max(most, Math.abs(v - gpu[i])), 0);
  console.log(`${ms.toFixed(0)} ms; GPU beside CPU: ${most.toExponential(1)} at most; derivatives by the eye: ${by}`);
  assert.equal(gpu.length, cpu.length);
  assert.ok(most < 1e-4, `${most}`);
  assert.ok(by.length === 3 && by.every((g) => Number.isFinite(g) && g !== 0), `${by}`);
} catch (error) {
  failed = true;
  console.log(error.stack);
}
await browser.close();
server.close();
process.exit(failed ? 1 : 0);
