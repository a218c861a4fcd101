// Draws the splats of the page's picture in WebGPU too. `takeOver` stops the page's own loop and gives two ways to draw that same picture,
// each of which waits until pixels of it can be read; `compute` is null where the browser has no WebGPU.
const GROUP = 64;
const WORDS = 3;
/** Numbers from one tile to the next: uniforms begin every 256 bytes. */
const TILE = 64;
const FOOTPRINTS = [0.1995, 0.2821, 0.3455, 0.3989, 0.446, 0.4886, 0.5278, 0.5642, 0.5984, 0.6308, 0.6616, 0.691, 0.7217, 0.766, 0.8301, 1];

/** shaders: null for the page's own way alone. */
async function takeOver(shaders) {
  const { world } = farfield;
  const { update } = world;
  const [camera, renderer] = await new Promise((taken) => {
    world.update = (...parts) => (taken(parts), false);
  });
  const page = new PagePath(world, update, camera, renderer);
  // What is hidden is known once the card has told of a picture; the next leaves it out.
  for (let n = 0; n < 2; n++) {
    page.draw();
    await page.settle();
  }
  return { page, compute: shaders && (await ComputePath.open(page, shaders)) };
}

/** Mean squared differences of two pictures as a ratio in dB. */
function psnr(a, b) {
  const sum = a.reduce((all, value, at) => all + (at % 4 < 3 ? (value - b[at]) ** 2 : 0), 0);
  return 10 * Math.log10((255 * 255 * 0.75 * a.length) / Math.max(sum, 1e-9));
}

/** The product's own way: WebGL2. */
class PagePath {
  constructor(world, update, camera, renderer) {
    Object.assign(this, { world, update, camera, renderer });
    this.gl = renderer.getContext();
    this.root = world;
    while (this.root.parent) this.root = this.root.parent;
    // What is drawn is chosen alike for both: that time is taken off.
    const { splats } = world.session;
    const { set } = splats;
    splats.set = (...parts) => {
      const begun = performance.now();
      set.apply(splats, parts);
      this.choosing = performance.now() - begun;
    };
  }

  draw() {
    this.world.invalidate();
    this.update.call(this.world, this.camera, this.renderer, true);
  }

  /** Averages the frame down into the canvas. */
  show() {
    this.renderer.render(this.root, this.camera);
  }

  /** Until the card has told how far one sees. */
  async settle() {
    const { reader } = this.world.session;
    while (reader.waiting.length > 0) await new Promise((resolve) => setTimeout(resolve, 2));
  }

  wait() {
    this.gl.readPixels(0, 0, 1, 1, this.gl.RGBA, this.gl.UNSIGNED_BYTE, new Uint8Array(4));
  }

  frame() {
    this.wait();
    const begun = performance.now();
    this.draw();
    this.show();
    this.wait();
    return performance.now() - begun - this.choosing;
  }

  /** What is on the canvas, to be read in the turn in which it was drawn. */
  pixels() {
    const { gl } = this;
    const { width, height } = gl.canvas;
    const bytes = new Uint8Array(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
    return bytes;
  }

  picture() {
    this.draw();
    this.show();
    return this.pixels();
  }

  /** Tiles drawn last, with their uniforms as numbers, and their runs. */
  get drawn() {
    const { splats } = this.world.session;
    const { uniforms } = splats.material;
    const { firsts, counts } = splats.culler.ranges;
    return splats.pool.slice(0, splats.tiles).map((points) => {
      const placement = splats.placements.get(points);
      if (placement.holeNode !== 1) throw new Error("something stands in for what is not there");
      splats.prepare(placement);
      const row = (name) => uniforms[name].value.toArray();
      const numbers = [...row("origin"), uniforms.pitch.value, ...row("toX"), 0, ...row("toY"), 0, ...row("toW"), 0, ...row("sun")];
      const { from, length, tile } = placement;
      const runs = Array.from({ length }, (_, n) => [firsts[from + n], counts[from + n]]);
      return { numbers, lattice: [...uniforms.lattice.value], words: uploaded.get(tile.buffer), runs };
    });
  }
}

/** WGSL: depths by atomics, then colours. */
class ComputePath {
  static async open(page, shaders) {
    const adapter = await navigator.gpu?.requestAdapter();
    if (!adapter) return null;
    const { maxStorageBufferBindingSize } = adapter.limits;
    const device = await adapter.requestDevice({ requiredLimits: { maxStorageBufferBindingSize } });
    const path = new ComputePath();
    const { vendor, architecture } = adapter.info;
    Object.assign(path, { page, device, adapter: `${vendor} ${architecture}` });
    path.makeFrame();
    path.makeTiles();
    await path.compile(shaders);
    return path;
  }

  makeFrame() {
    const { page, device } = this;
    const { width, height } = page.world.frame.target;
    const [columns, rows] = [page.gl.canvas.width, page.gl.canvas.height];
    const samples = width / columns;
    Object.assign(this, { width, height, columns, rows, bytes: 4 * width * height });
    const { ambientLight, sunLight, focal, near } = page.world.session.splats.material.uniforms;
    this.numbers = new Float32Array(48);
    this.numbers.set([...ambientLight.value.toArray(), focal.value, ...sunLight.value.toArray(), near.value]);
    this.numbers.set(page.world.air.uniforms.sky.value.toArray(), 8);
    new Uint32Array(this.numbers.buffer).set([samples, width, height], 11);
    this.numbers.set(FOOTPRINTS, 16);
    this.numbers.set(FOOTPRINTS.map((_, n) => Math.log2(Math.max(1 - (n + 1) / 16, 1e-30))), 32);
    const { STORAGE, COPY_SRC, COPY_DST, UNIFORM, MAP_READ, INDIRECT } = GPUBufferUsage;
    const make = (size, usage) => device.createBuffer({ size, usage });
    this.frame = make(4 * 48, UNIFORM | COPY_DST);
    this.depths = make(this.bytes, STORAGE | COPY_SRC | COPY_DST);
    this.colors = make(this.bytes, STORAGE | COPY_SRC | COPY_DST);
    this.staging = make(2 * this.bytes, MAP_READ | COPY_DST);
    this.pixel = make(256, MAP_READ | COPY_DST);
    this.listed = make(16, STORAGE | COPY_SRC | COPY_DST);
    this.indirect = make(16, INDIRECT | COPY_DST);
    this.canvas = Object.assign(document.createElement("canvas"), { width: columns, height: rows });
    this.canvas.style.cssText = "position: absolute; left: 0; top: 0; z-index: 9";
    document.body.append(this.canvas);
    this.context = this.canvas.getContext("webgpu");
    const usage = GPUTextureUsage.STORAGE_BINDING | GPUTextureUsage.COPY_SRC | GPUTextureUsage.RENDER_ATTACHMENT;
    this.context.configure({ device, format: "rgba8unorm", usage });
  }

  /** Uploads all pixels of the tiles drawn, as the page has done. */
  makeTiles() {
    const { device } = this;
    const { STORAGE, COPY_DST, UNIFORM } = GPUBufferUsage;
    this.drawn = this.page.drawn;
    const pixels = this.drawn.reduce((sum, { words }) => sum + words.length / WORDS, 0);
    new Uint32Array(this.numbers.buffer)[14] = pixels;
    this.words = device.createBuffer({ size: 4 * WORDS * pixels, usage: STORAGE | COPY_DST });
    let first = 0;
    for (const tile of this.drawn) {
      tile.first = first;
      for (let n = 0; n < WORDS; n++) {
        device.queue.writeBuffer(this.words, 4 * (n * pixels + first), tile.words.filter((_, at) => at % WORDS === n));
      }
      first += tile.words.length / WORDS;
    }
    const runs = this.drawn.flatMap((tile) => tile.runs);
    const chunks = runs.reduce((sum, [, count]) => sum + Math.ceil(count / GROUP), 0);
    this.splats = runs.reduce((sum, [, count]) => sum + count, 0);
    this.chunks = new Uint32Array(2 * chunks);
    this.tiles = new Float32Array(TILE * this.drawn.length);
    this.ends = new Uint32Array(this.drawn.length);
    this.chunkBuffer = device.createBuffer({ size: 8 * chunks, usage: STORAGE | COPY_DST });
    this.tileBuffer = device.createBuffer({ size: 4 * this.tiles.length, usage: STORAGE | UNIFORM | COPY_DST });
    this.list = device.createBuffer({ size: 8 * GROUP * chunks, usage: STORAGE });
  }

  /** Writes what is different from one picture to the next. */
  writeTiles() {
    const integers = new Int32Array(this.tiles.buffer);
    let at = 0;
    this.drawn.forEach(({ numbers, lattice, first, runs }, n) => {
      this.tiles.set(numbers, TILE * n);
      [integers[TILE * n + 7], integers[TILE * n + 11], integers[TILE * n + 15], integers[TILE * n + 19]] = [...lattice, at / 2, n];
      for (const [start, count] of runs) {
        for (let done = 0; done < count; done += GROUP) {
          this.chunks[at++] = first + start + done;
          this.chunks[at++] = Math.min(GROUP, count - done);
        }
      }
      this.ends[n] = at / 2;
    });
    const { queue } = this.device;
    queue.writeBuffer(this.frame, 0, this.numbers);
    queue.writeBuffer(this.tileBuffer, 0, this.tiles);
    queue.writeBuffer(this.chunkBuffer, 0, this.chunks);
    queue.writeBuffer(this.listed, 0, new Uint32Array([0, 1, 1, 0]));
  }

  async compile({ splats, resolve }) {
    const { device } = this;
    const types = ["uniform", "uniform", ...Array(2).fill("read-only-storage"), ...Array(4).fill("storage"), "read-only-storage"];
    const entries = types.map((type, binding) => ({
      binding, visibility: GPUShaderStage.COMPUTE, buffer: { type, hasDynamicOffset: binding === 1 },
    }));
    const bindings = device.createBindGroupLayout({ entries });
    const layout = device.createPipelineLayout({ bindGroupLayouts: [bindings] });
    const module = device.createShaderModule({ code: splats });
    const make = async (entryPoint) => [entryPoint, await device.createComputePipelineAsync({ layout, compute: { module, entryPoint } })];
    this.pipelines = Object.fromEntries(await Promise.all(["nearest", "color", "nearestListed", "colorListed", "atOnce"].map(make)));
    const { frame, tileBuffer, chunkBuffer, words, depths, colors, list, listed } = this;
    const buffers = [frame, tileBuffer, chunkBuffer, words, depths, colors, list, listed, tileBuffer];
    const resources = buffers.map((buffer, binding) => ({ binding, resource: { buffer, ...(binding === 1 && { size: 4 * TILE }) } }));
    this.group = device.createBindGroup({ layout: bindings, entries: resources });
    const compute = { module: device.createShaderModule({ code: resolve }), entryPoint: "resolve" };
    this.resolving = await device.createComputePipelineAsync({ layout: "auto", compute });
  }

  /** Commands that draw: "all", both passes over all splats; "listed", the second over those that were nearest once; or "at once". */
  encode(variant) {
    this.writeTiles();
    const encoder = this.device.createCommandEncoder();
    encoder.clearBuffer(this.depths);
    encoder.clearBuffer(this.colors);
    if (variant === "listed") {
      this.drawTiles(encoder, "nearestListed");
      encoder.copyBufferToBuffer(this.listed, 0, this.indirect, 0, 16);
      const pass = this.begin(encoder, "colorListed");
      pass.setBindGroup(0, this.group, [0]);
      pass.dispatchWorkgroupsIndirect(this.indirect, 0);
      pass.end();
    } else for (const name of variant === "all" ? ["nearest", "color"] : ["atOnce"]) this.drawTiles(encoder, name);
    return encoder;
  }

  begin(encoder, name) {
    const pass = encoder.beginComputePass();
    pass.setPipeline(this.pipelines[name]);
    return pass;
  }

  /** One call a tile: what threads next to each other read is then the same, which SwiftShader turns into one load. */
  drawTiles(encoder, name) {
    const pass = this.begin(encoder, name);
    this.ends.forEach((end, n) => {
      pass.setBindGroup(0, this.group, [4 * TILE * n]);
      pass.dispatchWorkgroups(end - (n > 0 ? this.ends[n - 1] : 0));
    });
    pass.end();
  }

  /** Commands that draw into the canvas of its own. */
  encodeCanvas(variant) {
    const encoder = this.encode(variant);
    const texture = this.context.getCurrentTexture();
    const resources = [{ buffer: this.frame }, { buffer: this.depths }, { buffer: this.colors }, texture.createView()];
    const pass = encoder.beginComputePass();
    pass.setPipeline(this.resolving);
    const entries = resources.map((resource, binding) => ({ binding, resource }));
    pass.setBindGroup(0, this.device.createBindGroup({ layout: this.resolving.getBindGroupLayout(0), entries }));
    pass.dispatchWorkgroups(Math.ceil(this.columns / GROUP), this.rows);
    pass.end();
    encoder.copyTextureToBuffer({ texture }, { buffer: this.pixel }, [1, 1]);
    return encoder;
  }

  /** Without the page: to a canvas of its own. */
  async alone(variant) {
    const begun = performance.now();
    this.device.queue.submit([this.encodeCanvas(variant).finish()]);
    await this.pixel.mapAsync(GPUMapMode.READ);
    this.pixel.unmap();
    return performance.now() - begun;
  }

  /** Into a texture of the page's WebGL2 by way of a canvas, without depth. */
  throughCanvas(variant) {
    const { gl, renderer } = this.page;
    this.page.wait();
    const begun = performance.now();
    this.device.queue.submit([this.encodeCanvas(variant).finish()]);
    const [texture, framebuffer] = [gl.createTexture(), gl.createFramebuffer()];
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, this.canvas);
    gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
    this.page.wait();
    const milliseconds = performance.now() - begun;
    gl.deleteFramebuffer(framebuffer);
    gl.deleteTexture(texture);
    renderer.resetState();
    return milliseconds;
  }

  /** Into the page's frame, by way of memory: near geometry, shadows, haze and the scene would go on from there. */
  async frameIn(variant) {
    const { page, device, bytes } = this;
    page.wait();
    const begun = performance.now();
    const encoder = this.encode(variant);
    encoder.copyBufferToBuffer(this.colors, 0, this.staging, 0, bytes);
    encoder.copyBufferToBuffer(this.depths, 0, this.staging, bytes, bytes);
    device.queue.submit([encoder.finish()]);
    await this.staging.mapAsync(GPUMapMode.READ);
    const range = this.staging.getMappedRange();
    this.upload(new Uint8Array(range, 0, bytes), new Float32Array(range, bytes));
    this.staging.unmap();
    page.show();
    page.wait();
    return performance.now() - begun;
  }

  async pictureIn(variant) {
    await this.frameIn(variant);
    this.page.show();
    return this.page.pixels();
  }

  upload(colors, depths) {
    const { gl, renderer, world } = this.page;
    const { texture, depthTexture } = world.frame.target;
    for (const flag of [gl.UNPACK_FLIP_Y_WEBGL, gl.UNPACK_PREMULTIPLY_ALPHA_WEBGL]) gl.pixelStorei(flag, false);
    const put = (of, format, type, values) => {
      gl.bindTexture(gl.TEXTURE_2D, renderer.properties.get(of).__webglTexture);
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, this.width, this.height, format, type, values);
    };
    gl.activeTexture(gl.TEXTURE0);
    put(texture, gl.RGBA, gl.UNSIGNED_BYTE, colors);
    put(depthTexture, gl.DEPTH_COMPONENT, gl.FLOAT, depths);
    renderer.resetState();
  }
}
