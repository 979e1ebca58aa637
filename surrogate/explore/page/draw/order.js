// The order of Gaussians by depth: nearest first, equal ones by index.

/** Sorts depths of float32 by their bits, in three passes over 11, 11 and 10 of these. */
export class Order {
  constructor(count) {
    this.depths = new Float32Array(count);
    this.keys = [new Uint32Array(this.depths.buffer), new Uint32Array(count)];
    this.numbers = [new Uint32Array(count), new Uint32Array(count)];
    this.counts = new Uint32Array(2048);
  }

  /** The numbers (count,) of the first `count` of `depths`, none negative, in order; `depths` are lost. */
  sorted(count = this.depths.length) {
    let [keys, otherKeys] = this.keys, [numbers, otherNumbers] = this.numbers;
    const { counts } = this;
    for (let i = 0; i < count; ++i) numbers[i] = i;
    for (const [shift, mask] of [[0, 2047], [11, 2047], [22, 1023]]) {
      counts.fill(0);
      for (let i = 0; i < count; ++i) ++counts[keys[i] >>> shift & mask];
      for (let bucket = 0, sum = 0; bucket <= mask; ++bucket) {
        const own = counts[bucket];
        counts[bucket] = sum;
        sum += own;
      }
      for (let i = 0; i < count; ++i) {
        const key = keys[i], at = counts[key >>> shift & mask]++;
        otherNumbers[at] = numbers[i];
        otherKeys[at] = key;
      }
      [keys, otherKeys] = [otherKeys, keys];
      [numbers, otherNumbers] = [otherNumbers, numbers];
    }
    return numbers.subarray(0, count);
  }
}
