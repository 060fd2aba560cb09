//! Numbers made of bytes, and sums of products as in twice the precision.

use arbitrary::{Arbitrary, Result, Unstructured};

/// Numbers at which something may change.
const EDGES: [f64; 32] = [
    f64::NAN,
    f64::INFINITY,
    f64::NEG_INFINITY,
    0.0,
    -0.0,
    0.5,
    1.0,
    -1.0,
    2.0,
    -0.5,
    -0.999_999,
    -1.0 + f64::EPSILON,
    1.0 - f64::EPSILON,
    1.0 + 1e-12,
    f64::MIN_POSITIVE,
    5e-324,
    f64::MAX,
    f64::MIN,
    1e-300,
    1e300,
    1e-160,
    1e160,
    1e-15,
    1e15,
    1e4,
    1e4 + 1e-8,
    1e6,
    -1e6,
    1e6 + 1e-6,
    0.1,
    0.49,
    9_007_199_254_740_993.0,
];

/// Any number, with those that make sense and those at an edge more often than others.
#[derive(Debug, Clone, Copy)]
pub struct Real(pub f64);

impl<'a> Arbitrary<'a> for Real {
    fn arbitrary(u: &mut Unstructured<'a>) -> Result<Self> {
        Ok(Self(match u.int_in_range(0..=9)? {
            0 => *u.choose(&EDGES)?,
            1 => u.arbitrary()?,
            2 => f64::from(u.arbitrary::<i8>()?),
            3 => 10.0_f64.powi(u.int_in_range(-320..=308)?) * f64::from(u.arbitrary::<i8>()?),
            4 => f64::from(u.arbitrary::<i16>()?) / 16.0,
            _ => f64::from(u.arbitrary::<u16>()?) / 65536.0,
        }))
    }
}

/// Seeded noise in [-1/2, 1/2).
pub fn noise(state: &mut u64) -> f64 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
}

/// The sum of products as if rounded once, but for some eps^2 of its terms (Ogita, Rump and Oishi 2005, Dot2).
pub fn dot(pairs: impl Iterator<Item = (f64, f64)>) -> f64 {
    let (mut sum, mut lost) = (0.0_f64, 0.0_f64);
    for (a, b) in pairs {
        let product = a * b;
        let (total, rest) = two_sum(sum, product);
        lost += rest + a.mul_add(b, -product);
        sum = total;
    }
    sum + lost
}

/// The rounded sum, and what rounding took.
pub fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let part = sum - a;
    (sum, (a - (sum - part)) + (b - part))
}
