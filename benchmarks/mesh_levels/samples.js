// A frame of k x k samples a pixel, averaged in linear light over the sky.
import * as THREE from "three";

const VERTEX = "void main() { gl_Position = vec4(position.xy, 0.0, 1.0); }";
const FRAGMENT = `
uniform highp sampler2D frame;
uniform int samples;
uniform vec3 sky;
void main() {
  ivec2 first = ivec2(gl_FragCoord.xy) * samples;
  vec4 sum = vec4(0.0);
  for (int j = 0; j < samples; j++) for (int i = 0; i < samples; i++) sum += texelFetch(frame, first + ivec2(i, j), 0);
  sum /= float(samples * samples);
  gl_FragColor = vec4(sum.rgb + (1.0 - sum.a) * sky, 1.0);
  #include <colorspace_fragment>
}`;

export class Samples {
  constructor(renderer, [width, height], samples, sky) {
    this.renderer = renderer;
    const texture = { type: THREE.UnsignedByteType, colorSpace: THREE.SRGBColorSpace, generateMipmaps: false };
    const filters = { minFilter: THREE.NearestFilter, magFilter: THREE.NearestFilter };
    this.target = new THREE.WebGLRenderTarget(width * samples, height * samples, { ...texture, ...filters, depthBuffer: true });
    this.target.texture.internalFormat = "SRGB8_ALPHA8";
    this.target.depthTexture = new THREE.DepthTexture(width * samples, height * samples, THREE.FloatType);
    const { r, g, b } = new THREE.Color(sky);
    const uniforms = { frame: { value: this.target.texture }, samples: { value: samples }, sky: { value: new THREE.Vector3(r, g, b) } };
    const material = new THREE.ShaderMaterial({ vertexShader: VERTEX, fragmentShader: FRAGMENT, uniforms, depthTest: false });
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.Float32BufferAttribute([-1, -1, 0, 3, -1, 0, -1, 3, 0], 3));
    const triangle = new THREE.Mesh(geometry, material);
    triangle.frustumCulled = false;
    this.resolve = new THREE.Scene();
    this.resolve.add(triangle);
    /** Of the last picture. */
    this.triangles = 0;
  }

  draw(scene, camera) {
    const { renderer } = this;
    renderer.setClearColor(0, 0);
    renderer.setRenderTarget(this.target);
    renderer.render(scene, camera);
    this.triangles = renderer.info.render.triangles;
    renderer.setRenderTarget(null);
    renderer.render(this.resolve, camera);
  }
}
