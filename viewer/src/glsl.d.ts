/** Shaders are imported as text. */
declare module "*.glsl" {
  const text: string;
  export default text;
}

/** A worker's whole program as text, made by the build. */
declare module "*?worker" {
  const text: string;
  export default text;
}
declare module "*.css";
