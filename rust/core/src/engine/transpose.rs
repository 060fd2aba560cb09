//! Rows into columns, in tiles of four.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined is compiled for the lowest CPU, not for the dispatched one"
)]

use pulp::Simd;

use super::Sample;

/// Lines of a row, `step` apart, side by side: place `i` of `places` holds sample `i` of every line. `length` is a multiple of four.
#[inline(always)]
pub fn to_lanes<T: Sample, S: Simd>(simd: S, lines: &[T], step: usize, length: usize, places: &mut [T]) {
    for lane in (0..T::LANES).step_by(4) {
        let line = |lane: usize| lines[lane * step..][..length].as_chunks::<4>().0;
        let (a, b, c, d) = (line(lane), line(lane + 1), line(lane + 2), line(lane + 3));
        let places = places[..length * T::LANES].chunks_exact_mut(4 * T::LANES);
        for ((((a, b), c), d), places) in a.iter().zip(b).zip(c).zip(d).zip(places) {
            let [a, b, c, d] = T::turn(simd, [*a, *b, *c, *d]);
            places[lane..lane + 4].copy_from_slice(&a);
            places[T::LANES + lane..][..4].copy_from_slice(&b);
            places[2 * T::LANES + lane..][..4].copy_from_slice(&c);
            places[3 * T::LANES + lane..][..4].copy_from_slice(&d);
        }
    }
}

/// The other way, with the lines one after the other.
#[inline(always)]
pub fn from_lanes<T: Sample, S: Simd>(simd: S, places: &[T], length: usize, lines: &mut [T]) {
    for (lines, lane) in lines[..length * T::LANES].chunks_exact_mut(4 * length).zip((0..).step_by(4)) {
        let (a, rest) = lines.split_at_mut(length);
        let (b, rest) = rest.split_at_mut(length);
        let (c, d) = rest.split_at_mut(length);
        let (a, b) = (a.as_chunks_mut::<4>().0, b.as_chunks_mut::<4>().0);
        let (c, d) = (c.as_chunks_mut::<4>().0, d.as_chunks_mut::<4>().0);
        let places = places.chunks_exact(4 * T::LANES);
        for ((((a, b), c), d), places) in a.iter_mut().zip(b).zip(c).zip(d).zip(places) {
            let mut tile = [[T::default(); 4]; 4];
            tile[0].copy_from_slice(&places[lane..lane + 4]);
            tile[1].copy_from_slice(&places[T::LANES + lane..][..4]);
            tile[2].copy_from_slice(&places[2 * T::LANES + lane..][..4]);
            tile[3].copy_from_slice(&places[3 * T::LANES + lane..][..4]);
            [*a, *b, *c, *d] = T::turn(simd, tile);
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
