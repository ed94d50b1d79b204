// The shapes of a robot model, each fixed to the frame of its link.

import {
  BoxGeometry,
  BufferAttribute,
  BufferGeometry,
  Color,
  CylinderGeometry,
  DirectionalLight,
  DoubleSide,
  HemisphereLight,
  Matrix4,
  Mesh,
  MeshLambertMaterial,
  Quaternion,
  SphereGeometry,
  Vector3,
} from "./three.js";

const ONE = new Vector3(1, 1, 1);

export class Shapes {
  constructor(scene) {
    this.scene = scene;
    this.mark = ""; // of what the server has
    this.all = []; // {frame, mesh, local}
    this.drawn = 0;
    this.color = new Color();
    scene.add(new HemisphereLight(0xffffff, 0x777788, 1.8));
    const sun = new DirectionalLight(0xffffff, 1.6);
    sun.position.set(2, -3, 5);
    scene.add(sun);
  }

  /** Loads what the server has, unless it is there; an empty mark: nothing. */
  async load(mark) {
    if (mark === this.mark) return;
    this.mark = mark;
    const found = mark ? await (await get("shapes.json")).json() : [];
    const geometries = new Map();
    for (const { kind, mesh } of found) {
      if (kind === "mesh" && !geometries.has(mesh)) geometries.set(mesh, loadMesh(mesh));
    }
    const loaded = new Map();
    for (const [number, geometry] of geometries) loaded.set(number, await geometry);
    if (mark !== this.mark) return; // others came meanwhile
    for (const { mesh } of this.all) {
      this.scene.remove(mesh);
      mesh.geometry.dispose();
      mesh.material.dispose();
    }
    this.all = found.map((shape) => this.#make(shape, loaded.get(shape.mesh)));
    this.setColor(this.color);
  }

  #make({ frame, kind, size, origin, color }, loaded) {
    const material = new MeshLambertMaterial({ side: DoubleSide });
    const [red, green, blue, opacity] = color ?? [0, 0, 0, 1];
    material.color.setRGB(red, green, blue, "srgb");
    material.opacity = opacity;
    material.transparent = opacity < 1;
    const mesh = new Mesh(loaded ?? geometryOf(kind, size), material);
    mesh.matrixAutoUpdate = false;
    mesh.frustumCulled = false;
    mesh.visible = false;
    this.scene.add(mesh);
    const [x, y, z, ...turn] = origin;
    const scale = kind === "mesh" ? new Vector3(...size) : ONE;
    const local = new Matrix4().compose(new Vector3(x, y, z), new Quaternion(...turn), scale);
    return { frame, mesh, local, isPlain: color === null };
  }

  /** Gives shapes without a color of their own this one. */
  setColor(color) {
    this.color = color;
    for (const { mesh, isPlain } of this.all) if (isPlain) mesh.material.color.copy(color);
  }

  /** Places all shapes in the world, relative to an origin. */
  place({ places, turns, seen, rowOf }, [ox, oy, oz], isShown) {
    const at = new Vector3();
    const turn = new Quaternion();
    this.drawn = 0;
    for (const { frame, mesh, local } of this.all) {
      const row = isShown ? rowOf(frame) : -1;
      mesh.visible = row >= 0 && seen[row] === 1;
      if (!mesh.visible) continue;
      this.drawn++;
      at.set(places[3 * row] - ox, places[3 * row + 1] - oy, places[3 * row + 2] - oz);
      turn.set(turns[4 * row], turns[4 * row + 1], turns[4 * row + 2], turns[4 * row + 3]);
      mesh.matrix.compose(at, turn, ONE).multiply(local);
      mesh.matrixWorldNeedsUpdate = true;
    }
  }
}

async function get(path) {
  const answer = await fetch(path, { cache: "no-store" });
  if (!answer.ok) throw new Error(`${path}: ${answer.status}`);
  return answer;
}

async function loadMesh(number) {
  const corners = new Float32Array(await (await get(`mesh/${number}`)).arrayBuffer());
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(corners, 3));
  geometry.computeVertexNormals(); // of each triangle: they share no corners
  return geometry;
}

function geometryOf(kind, size) {
  if (kind === "box") return new BoxGeometry(...size);
  if (kind === "sphere") return new SphereGeometry(size[0], 32, 20);
  const [radius, length] = size;
  return new CylinderGeometry(radius, radius, length, 32).rotateX(Math.PI / 2); // along z
}
