import type { WebGLRenderer } from "three";

const ANISOTROPY = 4;
/** Names of renderers that have no graphics card to draw with: Mesa's, Chromium's and Windows'. */
const SOFTWARE = /llvmpipe|softpipe|swiftshader|software|basic render/i;

/**
 * The anisotropy that near geometry's textures are filtered with. Software needs 30 times as long for a forest's leaves with it (118 s a
 * frame in place of 3.7), and for single frames over a city 5 s in place of 0.7.
 */
export function anisotropyOf(renderer: WebGLRenderer): number {
  const gl = renderer.getContext();
  const info = gl.getExtension("WEBGL_debug_renderer_info");
  const name = String(gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER));
  return SOFTWARE.test(name) ? 1 : Math.min(ANISOTROPY, renderer.capabilities.getMaxAnisotropy());
}
