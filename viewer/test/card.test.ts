import type { WebGLRenderer } from "three";
import { describe, expect, it } from "vitest";
import { anisotropyOf } from "../src/three/card.js";

const UNMASKED = 0x9246;
const RENDERER = 0x1f01;

function rendererOn(name: string, masked = false): WebGLRenderer {
  const gl = {
    RENDERER,
    getExtension: () => (masked ? null : { UNMASKED_RENDERER_WEBGL: UNMASKED }),
    getParameter: (what: number) => (what === (masked ? RENDERER : UNMASKED) ? name : "WebKit WebGL"),
  };
  return { getContext: () => gl, capabilities: { getMaxAnisotropy: () => 16 } } as never;
}

describe("anisotropyOf", () => {
  it("is little where software draws", () => {
    expect(anisotropyOf(rendererOn("ANGLE (Mesa, llvmpipe (LLVM 15.0.7, 256 bits), OpenGL 4.5)"))).toBe(1);
    expect(anisotropyOf(rendererOn("ANGLE (Google, Vulkan 1.3.0 (SwiftShader Device (Subzero)), SwiftShader driver)"))).toBe(1);
    expect(anisotropyOf(rendererOn("Microsoft Basic Render Driver", true))).toBe(1);
  });

  it("is more on a card", () => {
    expect(anisotropyOf(rendererOn("ANGLE (NVIDIA, NVIDIA GeForce RTX 3060 Direct3D11 vs_5_0 ps_5_0)"))).toBe(4);
    expect(anisotropyOf(rendererOn("Apple GPU", true))).toBe(4);
  });
});
