// What of the field is drawn: a setting's `clip`, both corners [x, y, z, x, y, z] of a box in world units, and its `slice`, [axis, place]
// of a plane.  null for none.  The emulated field alone can be cut; a choice of Gaussians waits until nothing is.

export const AXES = "xyz";

/** What applies of both: { clip, slice } without those that are not there; a surface has no colours for a slice. */
export const cutOf = ({ kind, clip, slice }) => ({ ...(clip && { clip }), ...(slice && kind !== "isovalue" && { slice }) });

export const isCut = setting => Object.keys(cutOf(setting)).length > 0;

/** What is to draw a setting, "" for the best. */
export const usedBy = setting => isCut(setting) && !setting.using.startsWith("field") ? "" : setting.using;

/** Whether there is an emulated field to be cut. */
export const canCut = facts => facts.model.representations.some(({ name }) => name.startsWith("field"));

/** The corners of what a setting leaves of a box, of a slice flat; null where that is all, or nothing. */
export function leftOf(setting, [low, high]) {
  const { clip, slice } = cutOf(setting);
  if (!clip && !slice) return null;
  const inside = corner => corner.map((x, k) => Math.min(Math.max(x, low[k]), high[k]));
  const left = clip ? [inside(clip.slice(0, 3)), inside(clip.slice(3))] : [[...low], [...high]];
  if (!slice) return left;
  const axis = AXES.indexOf(slice[0]), [from, to] = left.map(corner => corner[axis]);
  for (const corner of left) corner[axis] = slice[1];
  return from <= slice[1] && slice[1] <= to ? left : null;
}

/** Whether a setting's cut leaves nothing of a box to be drawn. */
export function isEmpty(setting, box) {
  const left = leftOf(setting, box), { slice } = cutOf(setting);
  return isCut(setting) && (!left || [0, 1, 2].some(k => AXES[k] !== slice?.[0] && left[0][k] >= left[1][k]));
}

/** A box, or null where it leaves nothing out of that of the run. */
export const clipOf = (corners, box) => corners.every((x, k) => x === box.flat()[k]) ? null : corners;

/** The box of a share of the way from a setting's to another's. */
export function clipBetween(a, b, share, box) {
  if (!a.clip && !b.clip) return null;
  const [first, last] = [a, b].map(({ clip }) => clip ?? box.flat());
  return clipOf(first.map((x, k) => x + (last[k] - x) * share), box);
}

/** A setting's cut in words. */
export function cutWords(setting, { box: [low, high] }) {
  const { clip, slice } = cutOf(setting), plain = x => String(+x.toPrecision(4)).replace("-", "−");
  const ends = clip ? [0, 1, 2].filter(k => clip[k] > low[k] || clip[3 + k] < high[k]).map(k => `${AXES[k]} = ${plain(clip[k])} to ${plain(clip[3 + k])}`) : [];
  return [...ends, ...(slice ? [`slice at ${slice[0]} = ${plain(slice[1])}`] : [])];
}

/** The box and the slice that a link holds, where they are some; `refuse(name, why)` hears of others. */
export function cutIn(clip, slice, refuse) {
  const corners = clip?.split(",").map(Number), [axis, place] = slice?.split(",") ?? [];
  const proper = corners?.length === 6 && corners.every(Number.isFinite) && clip.split(",").every(part => part.trim()) && corners.slice(0, 3).every((x, k) => x <= corners[3 + k]);
  const lies = AXES.includes(axis) && axis.length === 1 && place?.trim() && Number.isFinite(+place) && slice.split(",").length === 2;
  if (clip && !proper) refuse("clip", "is not a box");
  if (slice && !lies) refuse("slice", "is not x, y or z and a place");
  return { clip: proper ? corners : null, slice: lies ? [axis, +place] : null };
}
