// Cameras as the catalog has them (OpenCV axes: x right, y down, z into the picture), in the coordinates of the Gaussians.

/** A world camera {world_to_camera, fx, fy, cx, cy, width, height} in normalized coordinates, in float64. */
export function normalizedCamera(camera, { center, extent }) {
  const rows = camera.world_to_camera.slice(0, 3), rotation = rows.flatMap(row => row.slice(0, 3));
  const translation = rows.map(row => (row[0] * center[0] + row[1] * center[1] + row[2] * center[2] + row[3]) / extent);
  const position = [0, 1, 2].map(k => -rotation[k] * translation[0] - rotation[3 + k] * translation[1] - rotation[6 + k] * translation[2]);
  const { fx, fy, cx, cy, width, height } = camera;
  return { rotation, translation, position, fx, fy, cx, cy, width, height };
}

/** The same view with `times` as many pixels along each side. */
export function finer(camera, times) {
  const names = ["fx", "fy", "cx", "cy", "width", "height"];
  return { ...camera, ...Object.fromEntries(names.map(name => [name, camera[name] * times])) };
}
