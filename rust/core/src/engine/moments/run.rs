//! One run: block after block, with the moments that its windows need ahead of it.

#![expect(clippy::indexing_slicing, reason = "blocks are cut to the outputs, and what they read to the samples")]
#![expect(
    clippy::inline_always,
    reason = "what is not inlined is compiled for the lowest CPU, not for the dispatched one"
)]

use super::super::prefetch::prefetch;
use super::super::stream::rescale;
use super::super::{Sample, Windows};
use super::Moments;
use super::design::{Order, Shape, Tables};
use super::lay::Lay;
use super::room::{Place, Room, Source};

/// Blocks that are worked on at a time: enough for what happens once a step not to count.
pub const STEP: usize = 16;

/// Blocks whose sums are held in registers together: enough for these to be busy.
pub const FEW: usize = 8;

/// Bytes that are asked for before they are needed.
const AHEAD: usize = 4096;

/// What is to be computed, and where.
pub struct Run<'a, 'o, T: Sample> {
    pub moments: &'a Moments<T>,
    pub windows: Windows<'a, 'o, T>,
    pub room: &'a mut Room<T>,
}

/// Blocks that are worked on together.
struct Step {
    /// Where they start in x.
    here: isize,
    /// The number of the first in its row.
    block: isize,
    /// Outputs before it, from the start of the first step, and how many of those are not wanted.
    done: usize,
    lead: usize,
}

impl<'a, T: Sample> Run<'a, '_, T> {
    #[inline(always)]
    pub fn go<L: Lay<T>>(mut self, lay: L) {
        let block = self.moments.tables.shape.block.cast_signed();
        let Windows { first, origin, .. } = self.windows;
        let window = origin + first.cast_signed();
        let lead = window.rem_euclid(STEP.cast_signed() * block).cast_unsigned();
        // Where the step of the first window starts in x, and which block of the row that is.
        let start = first.cast_signed() - lead.cast_signed();
        let first = (window - lead.cast_signed()).div_euclid(block);
        let outputs = self.windows.outs.first().map_or(0, |out| out.len() / L::UNIT);
        self.warm_up(lay, start, first);
        for done in (0..lead + outputs).step_by(STEP * block.cast_unsigned()) {
            let step = Step { here: start + done.cast_signed(), block: first + done.cast_signed() / block, done, lead };
            self.bring::<L>(step.here);
            self.feed(lay, step.here, step.block);
            self.deliver(lay, &step);
        }
    }

    /// The moments of the blocks before those that come with the first outputs.
    #[inline(always)]
    fn warm_up<L: Lay<T>>(&mut self, lay: L, start: isize, first: isize) {
        let Shape { block, whole, .. } = self.moments.tables.shape;
        let (block, step) = (block.cast_signed(), STEP.cast_signed());
        let steps = whole.saturating_sub(1).div_ceil(STEP).cast_signed();
        let ahead = |number: isize| (whole.cast_signed() + number * step) * block;
        self.room.restart(start, start + ahead(-steps));
        for number in -steps..0 {
            // Where one piece holds both, what the first outputs read as their own stays.
            let from = start + if self.room.joined { ahead(number).min(0) } else { ahead(number) };
            self.room.far.bring(self.source::<L>(), from, start + ahead(number + 1));
            self.feed(lay, start + number * step * block, first + number * step);
        }
    }

    #[inline(always)]
    fn source<L: Lay<T>>(&self) -> Source<'a, T> {
        Source { x: self.windows.x, unit: L::UNIT, on_differences: self.moments.on_differences }
    }

    /// The stream that the step at `here` reads.
    #[inline(always)]
    fn bring<L: Lay<T>>(&mut self, here: isize) {
        let (source, room) = (self.source::<L>(), &mut *self.room);
        let Shape { block, whole, reach, .. } = self.moments.tables.shape;
        let (step, whole) = ((STEP * block).cast_signed(), (whole * block).cast_signed());
        let until = here + whole + block.cast_signed() + step + reach.cast_signed();
        room.far.bring(source, if room.joined { here } else { here + whole }, until);
        if !room.joined {
            room.near.bring(source, here, here + step);
        }
    }

    /// The moments of the last whole blocks of the step at `here`, which starts with `block` of the row, and what follows from
    /// them.
    #[inline(always)]
    fn feed<L: Lay<T>>(&mut self, lay: L, here: isize, block: isize) {
        let Self { moments: Moments { tables, .. }, room, .. } = self;
        let shape = tables.shape;
        if shape.whole == 0 {
            return;
        }
        let width = lay.width(tables);
        let samples = room.far.from(L::UNIT, here + (shape.whole * shape.block).cast_signed());
        let Some(group) = shape.group else {
            return lay.moments(tables, samples, room.plain.next(STEP * width, shape.whole * width));
        };
        lay.moments(tables, samples, &mut room.fresh);
        let place = Place::new(block + shape.whole.cast_signed(), group);
        let few = room.fresh.chunks_exact(FEW * width).zip(room.parts.chunks_exact_mut(FEW * width));
        for (number, (fresh, parts)) in few.enumerate() {
            let at = (place.index + number * FEW + group - shape.whole % FEW) & (group - 1);
            let lift = &tables.lift[at * shape.moments * tables.stride..];
            lay.products(tables, lift, fresh, parts, false);
        }
        // The end of one group, which is then complete, and the beginning of the next.
        let until = STEP.min(group - place.index);
        for (next, part) in (0..).zip([0..until, until..STEP]) {
            let slot = (place.group + next).cast_unsigned() & (room.slots - 1);
            let start = (place.index + part.start) & (group - 1);
            let complete = start + part.len() == group;
            let blocks = part.start * width..part.end * width;
            let (parts, sums) = (&room.parts[blocks.clone()], &mut room.prefix[blocks]);
            let lifted = &mut room.lifted[slot * group * width..][..group * width];
            lay.run_up(tables, parts, &mut lifted[start * width..][..parts.len()], &mut room.running, sums);
            if complete {
                lay.run_down(tables, lifted);
                lay.repeat(tables, Some(&room.running), &mut room.totals[slot * width..][..width]);
                lay.repeat(tables, None, &mut room.running);
                // Together with its last block a group is a whole one.
                lay.repeat(tables, None, &mut sums[(part.len() - 1) * width..]);
            }
        }
    }

    /// The outputs of a step.
    #[inline(always)]
    fn deliver<L: Lay<T>>(&mut self, lay: L, step: &Step) {
        let Self { moments: Moments { tables, .. }, windows: Windows { x, first, outs, .. }, room } = self;
        let Step { here, done, lead, .. } = *step;
        let shape = tables.shape;
        let length = STEP * shape.block;
        // What comes later is asked for with every tile, as memory takes few requests at a time.
        let grain = L::TOGETHER * shape.block;
        let (share, ahead) = (grain * L::UNIT, AHEAD / size_of::<T>());
        let samples: &[T] = x;
        let ask_for = |place: usize| {
            let place = (here + place.cast_signed()).max(0).cast_unsigned();
            prefetch(samples, place * L::UNIT + ahead, share);
        };
        for (number, (order, out)) in tables.orders.iter().zip(outs.iter_mut()).enumerate() {
            coefficients(lay, tables, order, number, room, step);
            let near = (if room.joined { &room.far } else { &room.near }).from(L::UNIT, here);
            let far = room.far.from(L::UNIT, here + ((shape.whole + 1) * shape.block).cast_signed());
            let own = T::from_f64(order.scale);
            let exact = own.to_f64() == order.scale;
            let scale = if exact { own } else { T::from_f64(1.0) };
            // The part of the step that is wanted, and what is computed with it.
            let (from, until) = (lead.saturating_sub(done), length.min(lead + out.len() / L::UNIT - done));
            let (start, end) = (from / grain * grain, until.next_multiple_of(grain).min(length));
            let place = done + from - lead;
            let (wanted, later) = out[place * L::UNIT..].split_at_mut((until - from) * L::UNIT);
            let all_wanted = end - start == until - from;
            let to = if all_wanted { &mut *wanted } else { &mut room.spare[..(end - start) * L::UNIT] };
            for (at, to) in (start..).step_by(grain).zip(to.chunks_mut(share)) {
                prefetch(later, (at * L::UNIT + ahead).saturating_sub(until * L::UNIT), share);
                if number == 0 {
                    ask_for(at + (shape.whole + 1 + STEP) * shape.block + shape.reach);
                    if !room.joined {
                        ask_for(at);
                    }
                }
                let samples = [&near[at * L::UNIT..], &far[at * L::UNIT..]];
                let coefficients = &room.coefficients[at / shape.block * lay.width(tables)..];
                lay.outputs(tables, order, samples, coefficients, scale, to);
            }
            if !all_wanted {
                wanted.copy_from_slice(&room.spare[(from - start) * L::UNIT..(until - start) * L::UNIT]);
            }
            if !exact {
                rescale(wanted, order.scale);
            }
            if let Some(anchor) = order.anchor {
                let x = &x[(*first + anchor + place) * L::UNIT..];
                wanted.iter_mut().zip(x).for_each(|(out, sample)| *out = *out + *sample);
            }
        }
    }
}

/// The coefficients of the outputs of a step.
#[inline(always)]
fn coefficients<T: Sample, L: Lay<T>>(
    lay: L,
    tables: &Tables<T>,
    order: &Order<T>,
    number: usize,
    room: &mut Room<T>,
    step: &Step,
) {
    let shape = tables.shape;
    let width = lay.width(tables);
    if shape.whole == 0 {
        return;
    }
    let Some(group) = shape.group else {
        return lay.blocks(tables, order, room.plain.last((shape.whole + STEP - 1) * width), &mut room.coefficients);
    };
    let Place { group: here, index } = Place::new(step.block, group);
    let matrix = shape.moments * tables.stride;
    let (from, slot) = (index * matrix, |group: isize| group.cast_unsigned() & (room.slots - 1));
    let after = &room.lifted[(slot(here) * group + index) * width..][..STEP * width];
    lay.products(tables, &order.near[from..], after, &mut room.coefficients, false);
    if shape.between > 0 {
        let whole = &mut room.whole[number * width..][..width];
        let start = index == 0 || step.done == 0;
        if start {
            lay.repeat(tables, None, whole);
        }
        // The last of the whole groups between begins to count within a group.
        let known = if start { 0 } else { shape.between - usize::from(index <= shape.more) };
        let turn = shape.more.saturating_sub(index).min(STEP);
        let counts = [shape.between - usize::from(turn > 0), shape.between - usize::from(turn == STEP)];
        for (known, count, part) in [(known, counts[0], 0..turn.max(1)), (counts[0], counts[1], turn.max(1)..STEP)] {
            for distance in known..count {
                let total = &room.totals[slot(here + 1 + distance.cast_signed()) * width..][..width];
                lay.product(tables, &order.groups[distance * matrix..], total, whole);
            }
            lay.repeat(tables, Some(whole), &mut room.wholes[part.start * width..part.end * width]);
        }
        lay.products(tables, &tables.restrict[from..], &room.wholes, &mut room.coefficients, true);
    }
    lay.products(tables, &order.far[from..], &room.prefix, &mut room.coefficients, true);
}
