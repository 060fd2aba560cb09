//! Designs made of bytes: of any parameters, or of those that can be had.

use std::sync::Arc;

use algdiff_core::control::Unattended;
use algdiff_core::design::{Design, MAX_WINDOW, Place};
use algdiff_core::error::Error;
use algdiff_core::kernel::Tau;
use algdiff_core::plan::Plan;
use algdiff_core::rule::RULES;
use arbitrary::{Arbitrary, Result, Unstructured};

use crate::numbers::Real;

/// A design of any parameters. Sizes are small, so that one is decided in some microseconds, or so large that they have to be
/// refused.
#[derive(Debug)]
pub struct Wish(pub Design);

impl<'a> Arbitrary<'a> for Wish {
    fn arbitrary(u: &mut Unstructured<'a>) -> Result<Self> {
        let window_length = match u.int_in_range(0..=15)? {
            0 => u.int_in_range(MAX_WINDOW + 1..=usize::MAX)?,
            1 => u.int_in_range(0..=200)?,
            _ => u.int_in_range(0..=40)?,
        };
        let degree = size(u, 6, 40)?;
        let deriv = if u.ratio(7, 8)? { degree.min(size(u, 3, 40)?) } else { size(u, 6, 40)? };
        Ok(Self(Design {
            window_length,
            deriv,
            degree,
            kappa: exponent(u)?,
            mu: exponent(u)?,
            place: place(u)?,
            delta: if u.ratio(3, 4)? {
                f64::from(u.int_in_range(1_u16..=2000)?) / 1000.0
            } else {
                u.arbitrary::<Real>()?.0
            },
            rule: u.choose(&RULES)?.1,
            trim: if u.ratio(3, 4)? { 0.0 } else { u.arbitrary::<Real>()?.0 },
        }))
    }
}

/// A design that can be had, unless its degree is too high for its window.
pub fn sound(u: &mut Unstructured<'_>, longest: usize) -> Result<Design> {
    let degree = u.int_in_range(0..=5)?;
    let rule = if u.ratio(2, 3)? { RULES[0].1 } else { u.choose(&RULES)?.1 };
    let shortest = degree + 2;
    let most = if u.ratio(3, 4)? { longest.min(48) } else { longest };
    let window_length = u.int_in_range(shortest..=most.max(shortest))? | usize::from(rule == RULES[3].1);
    let exponents: [f64; 6] = [0.0, 0.0, 1.0, 2.0, 0.5, -0.4];
    let tau = match u.int_in_range(0..=5)? {
        0 | 1 => Tau::Center,
        2 => Tau::Newest,
        3 => Tau::Root,
        _ => Tau::At(f64::from(u.int_in_range(-8_i8..=40)?) / 32.0),
    };
    Ok(Design {
        window_length,
        deriv: u.int_in_range(0..=degree.min(3))?,
        degree,
        kappa: *u.choose(&exponents)?,
        mu: *u.choose(&exponents)?,
        place: Place::Tau(tau),
        delta: *u.choose(&[0.01, 1.0, 3.0])?,
        rule,
        trim: if u.ratio(1, 8)? { 0.02 } else { 0.0 },
    })
}

/// The plan of such a design, and of the others of the orders that are wanted.
pub fn plans(design: &Design, orders: usize) -> std::result::Result<Vec<Arc<Plan>>, Error> {
    let highest = design.degree.min(design.deriv + orders - 1);
    (design.deriv..=highest).map(|deriv| Plan::new(&Design { deriv, ..*design }, &Unattended).map(Arc::new)).collect()
}

/// A size that makes sense, one that is possible, or any.
fn size(u: &mut Unstructured<'_>, usual: usize, most: usize) -> Result<usize> {
    match u.int_in_range(0..=31)? {
        0 => u.int_in_range(501..=usize::MAX),
        1 => u.int_in_range(0..=most),
        _ => u.int_in_range(0..=usual),
    }
}

/// An exponent of the weight.
fn exponent(u: &mut Unstructured<'_>) -> Result<f64> {
    Ok(match u.int_in_range(0..=3)? {
        0 => u.arbitrary::<Real>()?.0,
        1 => f64::from(u.arbitrary::<u8>()?) / 128.0 - 1.0,
        _ => f64::from(u.int_in_range(0_u8..=4)?),
    })
}

fn place(u: &mut Unstructured<'_>) -> Result<Place> {
    Ok(match u.int_in_range(0..=7)? {
        0 => Place::Tau(Tau::Center),
        1 => Place::Tau(Tau::Root),
        2 => Place::Tau(Tau::Newest),
        3 => Place::Delay(u.arbitrary::<Real>()?.0),
        4 => Place::Position(u.arbitrary::<Real>()?.0),
        5 => Place::Position(f64::from(u.arbitrary::<i8>()?) / 2.0),
        _ => Place::Tau(Tau::At(u.arbitrary::<Real>()?.0)),
    })
}
