// Pictures of an emulated field by plain scripts; see surrogate/model/emulated_member.py.

import { finer } from "draw/camera.js";
import { castVolume } from "draw/casting.js";
import { boundsOf, clipped, sliced } from "draw/cuts.js";
import { continued, rangeOf } from "draw/field.js";
import { cameraOf, drawnRange, drawnValues, fittingDistance, hiddenCells, knotsOf, raysOf, SAMPLES } from "draw/rays.js";
import { averaged } from "draw/samples.js";
import { castSurface } from "draw/surfaces.js";
import { trianglesOf } from "draw/triangles.js";

export class FieldScripts {
  /** Of fields; see field.js. */
  constructor(fields) {
    this.fields = fields;
    this.kept = null; // the field of the last parameters
  }

  /** Show the field at parameters by name, in the appearance of a visualization, or under another transfer function; `cut` has a clip and a slice. */
  set(parameters, visualization = {}, transfer = null, cut = {}) {
    const { fields } = this, { appearance, distance } = fields.appearance(visualization, transfer), key = JSON.stringify([appearance.number, parameters]);
    if (this.kept?.key !== key) this.kept = { key, field: fields.at(appearance.number, parameters) };
    const { field } = this.kept;
    this.appearance = appearance;
    this.whole = appearance.kind === "isosurface" ? trianglesOf(field, appearance.isovalue, fields.record.cases) : null;
    const shown = cut.slice ? sliced(appearance, field.spacing) : appearance;
    if (!this.whole) this.useVolume(volumeOf(field, shown, fields.record.headlight), cut.slice ? Math.min(...field.spacing) : distance);
    this.cutTo(cut);
  }

  /** Cut what is shown otherwise, with a slice if and only if there was one. */
  cutTo(cut) {
    const { whole, kept: { field } } = this, bounds = boundsOf(cut, field);
    if (whole) this.useSurface(field, cut.clip ? clipped(whole, bounds) : whole);
    else Object.assign(this.volume, bounds);
  }

  useVolume(volume, distance) {
    this.volume = volume;
    this.surface = null;
    const draw = (camera, apart) => this.castVolume(camera, apart);
    this.distance = distance ?? fittingDistance(draw, this.fields.record.camera, volume.spacing);
  }

  useSurface(field, triangles) {
    const { color, ambient, diffuse, specular, specular_power: power } = this.appearance;
    this.surface = { triangles, look: { color, light: [ambient, diffuse, specular, power], spacing: field.spacing }, grid: field };
  }

  castVolume(camera, distance) {
    return castVolume(this.volume, raysOf(camera, this.volume), distance);
  }

  /** The picture of a world camera: premultiplied RGBA (H, W, 4) float32. */
  draw(camera) {
    if (!this.surface) return this.castVolume(camera, this.distance);
    const { triangles, look, grid } = this.surface, fine = finer(camera, SAMPLES);
    return averaged(castSurface(triangles, look, raysOf(fine, grid), cameraOf(fine, grid), fine), camera.width, camera.height, SAMPLES);
  }
}

/** A field as rays meet it under a volume rendering: its drawn values, cells that are hidden, and the function. */
function volumeOf(field, { transfer_function: transfer, shaded }, headlight) {
  const range = drawnRange(rangeOf(field), transfer);
  return {
    values: drawnValues(shaded ? continued(field) : field.values, range), hidden: field.holes && hiddenCells(field), size: field.size,
    ...boundsOf({}, field), spacing: field.spacing, origin: field.origin, knots: knotsOf(transfer, range), unit: transfer.opacity_unit_distance, light: shaded ? headlight : null,
  };
}
