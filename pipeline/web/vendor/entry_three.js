// What of three.js pages use: esbuild leaves out the rest.
export {
  BackSide, BufferAttribute, BufferGeometry, DoubleSide, FrontSide, Group, Matrix4, Mesh, OrthographicCamera, Scene,
  ShaderMaterial, Vector3, WebGLRenderer,
} from "three";
export {OrbitControls} from "three/addons/controls/OrbitControls.js";
