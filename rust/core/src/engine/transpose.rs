//! Rows into columns, in tiles of four.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined is compiled for the lowest CPU, not for the dispatched one"
)]

use pulp::Simd;

use super::Sample;

/// `to[column * to_step + row] = from[row * from_step + column]` for `rows` rows, a multiple of four, and `columns` columns, a multiple
/// of four.
#[inline(always)]
pub fn transpose<T: Sample, S: Simd>(
    simd: S,
    from: &[T],
    from_step: usize,
    to: &mut [T],
    to_step: usize,
    rows: usize,
    columns: usize,
) {
    for row in (0..rows).step_by(4) {
        let line = |line: usize| from[(row + line) * from_step..][..columns].as_chunks::<4>().0;
        let tiles = line(0).iter().zip(line(1)).zip(line(2)).zip(line(3));
        for ((((a, b), c), d), to) in tiles.zip(to[row..].chunks_mut(4 * to_step)) {
            let turned = T::turn(simd, [*a, *b, *c, *d]);
            for (line, values) in to.chunks_mut(to_step).zip(turned) {
                line[..4].copy_from_slice(&values);
            }
        }
    }
}

/// A tile turned by moves that compile to shuffles.
#[inline(always)]
pub fn turn<T: Copy>([a, b, c, d]: [[T; 4]; 4]) -> [[T; 4]; 4] {
    let low = |a: [T; 4], b: [T; 4]| [a[0], b[0], a[2], b[2]];
    let high = |a: [T; 4], b: [T; 4]| [a[1], b[1], a[3], b[3]];
    let first = |a: [T; 4], b: [T; 4]| [a[0], a[1], b[0], b[1]];
    let last = |a: [T; 4], b: [T; 4]| [a[2], a[3], b[2], b[3]];
    let (p, q, r, s) = (low(a, b), high(a, b), low(c, d), high(c, d));
    [first(p, r), first(q, s), last(p, r), last(q, s)]
}
