// Run before the page: keeps what is uploaded into buffers of vertices, so that another way to draw has the same splats.
window.uploaded = new WeakMap();
{
  const { bindBuffer, bufferData } = WebGL2RenderingContext.prototype;
  let bound = null;
  WebGL2RenderingContext.prototype.bindBuffer = function (target, buffer) {
    if (target === this.ARRAY_BUFFER) bound = buffer;
    return bindBuffer.call(this, target, buffer);
  };
  WebGL2RenderingContext.prototype.bufferData = function (target, values, ...rest) {
    if (target === this.ARRAY_BUFFER && bound && values instanceof Uint32Array) uploaded.set(bound, values);
    return bufferData.call(this, target, values, ...rest);
  };
}
