// What error to expect of a picture, and in which words; see surrogate/answers/survey.py and doubt.py.

import { interpolated } from "draw/nodes.js";
import { Processes } from "draw/processes.js";

const LEAST_OPEN = 1e-9, MOST_DECIBELS = 60, MOST_OPAQUE = 0.999;
const NEW = 0.05, MAGNIFIED = 4, SAMPLES = 8; // of functions that show what no trained one did; as in surrogate/answers/doubt.py
const NEARER = 1.2, ASIDE = 0.25, LEAST_ANGLE = Math.PI / 180; // as in surrogate/answers/views.py
const LIKE = "like a run that was simulated", BETWEEN = "between runs", FAR = "far from all runs", NEVER = "never shown in training";
const FRACTIONS = new Intl.NumberFormat("en", { style: "percent" });

export class Doubt {
  /** `survey`, `views` and `seen` (the last two may be null) as a page holds them; `parameters` are those of the model. */
  constructor({ survey, views, seen }, parameters) {
    const processes = ({ coefficients = [], groups = [], ...numbers }) =>
      new Processes(name => ({ data: (numbers[name] ?? coefficients).flat(), shape: [numbers.points.length, numbers.points[0].length] }), groups);
    Object.assign(this, { survey, views, seen, parameters });
    this.opens = survey.opens.map(one => ({ processes: processes(one), variances: one.variances }));
    this.rests = Object.fromEntries(Object.entries(survey.expectations).map(([using, one]) => [using, processes(one.rest)]));
  }

  /** The shares of what the runs leave open at a normalized point. */
  shares(point) {
    return this.opens.map(({ processes, variances }) =>
      Math.max(LEAST_OPEN, variances.reduce((sum, variance, group) => sum + (variance && variance * processes.open(point, group)), 0)));
  }

  /** The PSNR (dB) to expect of a representation's pictures at a normalized point: { psnr, low, high }; null where nobody knows. */
  numbers(point, using, shares = this.shares(point)) {
    const own = this.survey.expectations[using];
    if (!own) return null;
    const rest = this.rests[using].expected(point)[0];
    const psnr = Math.min(MOST_DECIBELS, own.slopes.reduce((sum, slope, i) => sum + slope * Math.log(shares[i]), own.constant + rest));
    return { psnr, low: Math.max(0, psnr - own.half), high: Math.min(MOST_DECIBELS, psnr + own.half) };
  }

  /**
   * What to expect of a picture, as the program's `Interval`.  `values` are parameters by name, `point` the same normalized, `transfer`
   * the function where one shows it, `trained` whether it is shown as most pictures of training were.
   */
  interval({ values, point, camera, transfer, using, trained }) {
    const beyond = this.parameters.filter(({ name, low, high }) => values[name] < low || values[name] > high).map(({ name }) => name);
    if (beyond.length) return said(NEVER, null, `${beyond.join(", ")} beyond the bounds`);
    const fresh = transfer && this.seen ? newShare(this.seen, transfer) : 0;
    if (fresh > NEW) return said(NEVER, null, `no trained transfer function showed ${Math.round(100 * fresh)}% of what this one shows`);
    if (this.views && !covered(this.views, camera)) return said(NEVER, null, "no stored image looks from there");
    const shares = this.shares(point), [share] = shares, { like, between } = this.survey;
    const words = share <= like ? LIKE : share <= between ? BETWEEN : FAR;
    if (!trained) return said(words, null, "this page knows errors of the trained appearance alone");
    const numbers = this.numbers(point, using, shares);
    if (!numbers) return said(words, null, "too few members calibrate it: nobody can say how far off the picture is");
    return said(words, { ...numbers, ...this.survey.expectations[using] });
  }
}

/** What to expect of a picture that is like none of training, and why. */
export const never = why => said(NEVER, null, why);

/** Words and numbers, and sentences of both. */
function said(words, numbers, why = "") {
  const { psnr = null, low = null, high = null, share = null, source = "" } = numbers ?? {};
  const dB = x => `${x.toFixed(1)} dB`, expected = psnr === MOST_DECIBELS ? `${MOST_DECIBELS} dB or more` : numbers && dB(psnr);
  const range = high === MOST_DECIBELS ? `${numbers && dB(low)} or more` : `${low?.toFixed(1)} to ${numbers && dB(high)}`;
  const within = (begin, end) => low === MOST_DECIBELS ? "" : begin + range + end;
  const short = numbers ? `${words}: PSNR ${expected}${within(" (", ")")}` : `${words}: ${why}`;
  const sentence = numbers
    ? `${words}: PSNR ${expected}${within(", ", "")} in ${FRACTIONS.format(share)} of such pictures (calibrated by ${source})` : short;
  return { words, psnr, low, high, share, source, why, short, sentence, warning: !numbers || words === FAR };
}

/** Of what a transfer function shows, the share that training did not; see surrogate/evaluation/novelty.py. */
export function newShare({ edges, frequency, extinctions }, transfer) {
  let whole = 0, fresh = 0;
  frequency.forEach((often, i) => {
    let depth = 0;
    for (let k = 0; k < SAMPLES; ++k) {
      const value = edges[i] + (edges[i + 1] - edges[i]) * (k + 0.5) / SAMPLES;
      depth -= Math.log1p(-Math.min(interpolated(transfer.opacity_points, value), MOST_OPAQUE)) / SAMPLES;
    }
    const extinction = depth / transfer.opacity_unit_distance;
    whole += often * extinction;
    fresh += often * Math.max(0, extinction - MAGNIFIED * extinctions[i]);
  });
  return whole > 0 ? fresh / whole : 0;
}

/** Whether some stored camera sees about what a camera sees; see surrogate/answers/views.py. */
export function covered({ middle, distances, sizes, aside, gap, directions }, camera) {
  const rows = camera.world_to_camera, towards = rows.slice(0, 3).map(row => row[0] * middle[0] + row[1] * middle[1] + row[2] * middle[2] + row[3]);
  const [x, y, distance] = towards, length = Math.hypot(...towards) || 1;
  if (distance <= 0) return false;
  const away = [0, 1, 2].map(k => -(rows[0][k] * x + rows[1][k] * y + rows[2][k] * distance) / length);
  const size = distance * Math.min(camera.width / camera.fx, camera.height / camera.fy) / 2;
  const nearest = Math.min(...directions.map(direction => Math.hypot(...direction.map((part, k) => part - away[k]))));
  const apart = 2 * Math.asin(Math.min(1, nearest / 2));
  return Math.min(distance / distances[0], size / sizes[0]) >= 1 / NEARER && Math.max(distance / distances[1], size / sizes[1]) <= NEARER
    && Math.hypot(x, y) / size <= aside + ASIDE && apart <= Math.max(gap, LEAST_ANGLE) + 1e-5;
}
