/** The things of a view in space, as three.js wants them. World: z up, metres. */
import type { Camera, Scene, Vector } from "gravisight";
import {
  BoxGeometry,
  BufferGeometry,
  CatmullRomCurve3,
  Color,
  DoubleSide,
  EdgesGeometry,
  GridHelper,
  Group,
  Line,
  LineBasicMaterial,
  LineSegments,
  MathUtils,
  Matrix3,
  Matrix4,
  Mesh,
  MeshBasicMaterial,
  MeshLambertMaterial,
  Object3D,
  OctahedronGeometry,
  Plane,
  PlaneGeometry,
  Points,
  PointsMaterial,
  Quaternion,
  SphereGeometry,
  TubeGeometry,
  Vector3,
} from "three";

export const UP = new Vector3(0, 0, 1);

/** Floor, lines, net, boxes and walls, as far as `span` around `centre`; `colour` gives the page's colours. */
export function placeOf({ floor, lines = [], net = [], boxes = [], walls = [] }: Scene, centre: Vector3, span: number, colour: (name: string) => Color): Object3D {
  const group = new Group();
  const quiet = colour("--quiet");
  if (floor) {
    // One line a metre; fewer where that would be a grey field.
    const cell = span > 60 ? 10 : span > 30 ? 5 : 1;
    const cells = 2 * Math.ceil(span / 2 / cell);
    const grid = new GridHelper(cells * cell, cells, quiet, colour("--line").lerp(quiet, 0.35));
    grid.rotateX(MathUtils.degToRad(90));
    grid.position.set(Math.round(centre.x / cell) * cell, Math.round(centre.y / cell) * cell, floor.height);
    group.add(grid);
  }
  const ends = [...lines.flat(), ...net.slice(1).flatMap((end, index) => [net[index]!, end])].map((end) => new Vector3(...end));
  if (ends.length) group.add(new LineSegments(new BufferGeometry().setFromPoints(ends), new LineBasicMaterial({ color: colour("--ink") })));
  for (const { position, half_size, yaw = 0, rotation } of boxes) {
    const geometry = new BoxGeometry(...new Vector3(...half_size).multiplyScalar(2).toArray());
    const box = new Mesh(geometry, new MeshLambertMaterial({ color: quiet, transparent: true, opacity: 0.28, depthWrite: false }));
    box.add(new LineSegments(new EdgesGeometry(geometry), new LineBasicMaterial({ color: quiet })));
    box.position.fromArray(position);
    box.quaternion.copy(orientationOf(rotation) ?? new Quaternion().setFromAxisAngle(UP, yaw));
    group.add(box);
  }
  for (const { point, normal } of walls) {
    const height = Math.min(3, span);
    const middle = floor ? centre.clone().setZ(floor.height + height / 2) : centre;
    group.add(wallOf(new Plane().setFromNormalAndCoplanarPoint(new Vector3(...normal).normalize(), new Vector3(...point)), middle, span, height, quiet));
  }
  return group;
}

/** The orientation of a box that has more than a yaw. */
function orientationOf(rotation: NonNullable<Scene["boxes"]>[number]["rotation"]): Quaternion | undefined {
  if (!rotation) return undefined;
  const [first, second, third] = rotation;
  if (Array.isArray(first) && Array.isArray(second) && Array.isArray(third)) {
    const [[a, b, c], [d, e, f], [g, h, i]] = [first, second, third];
    const matrix = new Matrix4().set(a, b, c, 0, d, e, f, 0, g, h, i, 0, 0, 0, 0, 1);
    return new Quaternion().setFromRotationMatrix(matrix);
  }
  const [w, x, y, z] = rotation as [number, number, number, number];
  return new Quaternion(x, y, z, w).normalize();
}

function wallOf(plane: Plane, middle: Vector3, width: number, height: number, color: Color): Object3D {
  const geometry = new PlaneGeometry(width, height);
  const wall = new Mesh(geometry, new MeshBasicMaterial({ color, transparent: true, opacity: 0.08, side: DoubleSide, depthWrite: false }));
  wall.add(new LineSegments(new EdgesGeometry(geometry), new LineBasicMaterial({ color, transparent: true, opacity: 0.5 })));
  plane.projectPoint(middle, wall.position);
  wall.up.copy(UP);
  wall.lookAt(wall.position.clone().add(plane.normal));
  return wall;
}

/** The camera as the pyramid that it sees, `length` deep. */
export function frustumOf(camera: Camera, length: number, color: Color): Object3D {
  const { width, height, intrinsic } = camera;
  const toRay = new Matrix3().fromArray(intrinsic.flat()).transpose().invert();
  const corners = [[0, 0], [width, 0], [width, height], [0, height]].map(([u, v]) => new Vector3(u, v, 1).applyMatrix3(toRay).multiplyScalar(length));
  const lines = corners.flatMap((corner, index) => [new Vector3(), corner, corner, corners[(index + 1) % corners.length]!]);
  const frustum = new LineSegments(new BufferGeometry().setFromPoints(lines), new LineBasicMaterial({ color }));
  frustum.applyMatrix4(worldFromCamera(camera));
  return frustum;
}

/** A path that is noisy: dots on a thin line. */
export function dotsOf(points: Vector[], color: Color, size: number): Object3D {
  const geometry = new BufferGeometry().setFromPoints(points.map((point) => new Vector3(...point)));
  const line = new Line(geometry, new LineBasicMaterial({ color, transparent: true, opacity: 0.4 }));
  line.add(new Points(geometry, new PointsMaterial({ color, size, sizeAttenuation: false })));
  return line;
}

/** A path that is smooth: a tube, thick enough to be seen. */
export function tubeOf(points: Vector[], color: Color, radius: number): Object3D {
  const curve = new CatmullRomCurve3(points.map((point) => new Vector3(...point)));
  curve.arcLengthDivisions = Math.min(4 * points.length, 4000);
  return new Mesh(new TubeGeometry(curve, Math.min(3 * points.length, 3000), radius, 6), new MeshLambertMaterial({ color }));
}

export function ballOf(point: Vector, color: Color, radius: number): Object3D {
  const ball = new Mesh(new SphereGeometry(radius, 24, 16), new MeshLambertMaterial({ color }));
  ball.position.fromArray(point);
  return ball;
}

export function marksOf(points: Vector[], color: Color, size: number): Object3D {
  const marks = new Group();
  for (const point of points) {
    // Through whatever stands before it: a mark is a note, not a thing.
    const mark = new Mesh(new OctahedronGeometry(size), new MeshBasicMaterial({ color, depthTest: false, transparent: true, opacity: 0.9 }));
    mark.position.fromArray(point);
    marks.add(mark);
  }
  return marks;
}

/** Where a camera is, and a place in front of it. */
export function poseOf(camera: Camera): { position: Vector3; ahead: Vector3 } {
  const matrix = worldFromCamera(camera);
  return { position: new Vector3().setFromMatrixPosition(matrix), ahead: new Vector3(0, 0, 6).applyMatrix4(matrix) };
}

function worldFromCamera(camera: Camera): Matrix4 {
  // Rows, where three.js wants columns.
  return new Matrix4().fromArray(camera.camera_from_world.flat()).transpose().invert();
}

/** Gives back what an object holds on the graphics card. */
export function free(object: Object3D): void {
  object.traverse((part) => {
    const { geometry, material } = part as Partial<Mesh>;
    geometry?.dispose();
    for (const each of [material ?? []].flat()) each.dispose();
  });
}
