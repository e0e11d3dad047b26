//! [`super::Resize`] eight pixels at a time on processors with AVX2: the same numbers, bit by bit.

// Every use is proven beside it.
#![allow(unsafe_code)]

use std::arch::x86_64::{
    __m256, _mm256_add_ps, _mm256_blendv_ps, _mm256_castsi256_ps, _mm256_loadu_ps,
    _mm256_loadu_si256, _mm256_mul_ps, _mm256_permutevar8x32_ps, _mm256_set1_ps, _mm256_slli_epi32,
    _mm256_storeu_ps, _mm256_sub_ps,
};

use super::{Tap, mix};

/// Taps of the columns in groups of eight, whose sources lie within sixteen pixels.
#[derive(Debug)]
pub(super) struct Groups {
    groups: Vec<Group>,
    /// A row that was mixed of two, a plane a channel, with sixteen pixels to spare.
    row: [Vec<f32>; 3],
}

#[derive(Debug)]
struct Group {
    /// The first source pixel, from which `low` and `high` count.
    start: usize,
    low: [i32; 8],
    high: [i32; 8],
    weight: [f32; 8],
}

const REACH: usize = 16;

impl Groups {
    /// `None` where the processor lacks AVX2, the columns are no whole groups or lie too far apart.
    pub(super) fn new(columns: &[Tap], source_width: usize) -> Option<Self> {
        let (groups, rest) = columns.as_chunks::<8>();
        if !is_x86_feature_detected!("avx2") || !rest.is_empty() {
            return None;
        }
        let group = |taps: &[Tap; 8]| {
            let start = taps[0].low;
            let is_near = |tap: &Tap| tap.low >= start && tap.high < start + REACH;
            taps.iter().all(is_near).then(|| Group {
                start,
                low: taps.map(|tap| (tap.low - start) as i32),
                high: taps.map(|tap| (tap.high - start) as i32),
                weight: taps.map(|tap| tap.weight),
            })
        };
        Some(Self {
            groups: groups.iter().map(group).collect::<Option<_>>()?,
            row: std::array::from_fn(|_| vec![0.0; source_width + REACH]),
        })
    }

    /// One row of the target, a plane a channel, from the two rows of the source that `weight`
    /// mixes.
    pub(super) fn apply(
        &mut self,
        [low, high]: [&[u8]; 2],
        weight: f32,
        normal: [[f32; 2]; 3],
        target: [&mut [f32]; 3],
    ) {
        // SAFETY: `new` makes groups only where the processor has AVX2.
        unsafe {
            mix_rows(low, high, weight, &mut self.row);
            for ((row, normal), target) in self.row.iter().zip(normal).zip(target) {
                mix_columns(row, &self.groups, normal, target);
            }
        }
    }
}

#[target_feature(enable = "avx2")]
fn mix_rows(low: &[u8], high: &[u8], weight: f32, [red, green, blue]: &mut [Vec<f32>; 3]) {
    let pixels = low.as_chunks::<3>().0.iter().zip(high.as_chunks::<3>().0);
    for ((((low, high), red), green), blue) in pixels.zip(red).zip(green).zip(blue) {
        let mixed = |channel: usize| mix(low[channel].into(), high[channel].into(), weight);
        *red = mixed(0);
        *green = mixed(1);
        *blue = mixed(2);
    }
}

#[target_feature(enable = "avx2")]
fn mix_columns(row: &[f32], groups: &[Group], [scale, offset]: [f32; 2], target: &mut [f32]) {
    let (scale, offset) = (_mm256_set1_ps(scale), _mm256_set1_ps(offset));
    for (group, target) in groups.iter().zip(target.as_chunks_mut::<8>().0) {
        let Some(([first, second], _)) = row
            .get(group.start..)
            .map(|row| row.as_chunks::<8>().0)
            .and_then(|halves| halves.split_first_chunk::<2>())
        else {
            return;
        };
        let [first, second] = [load(first), load(second)];
        let low = pick(first, second, &group.low);
        let high = pick(first, second, &group.high);
        let step = _mm256_mul_ps(load(&group.weight), _mm256_sub_ps(high, low));
        let mixed = _mm256_add_ps(low, step);
        let normal = _mm256_add_ps(_mm256_mul_ps(mixed, scale), offset);
        // SAFETY: there is room for eight floats.
        unsafe { _mm256_storeu_ps(target.as_mut_ptr(), normal) };
    }
}

/// Of sixteen floats those at the eight places, each below sixteen.
#[target_feature(enable = "avx2")]
#[inline]
fn pick(first: __m256, second: __m256, places: &[i32; 8]) -> __m256 {
    // SAFETY: eight integers of 32 bits are there to be read.
    let places = unsafe { _mm256_loadu_si256(places.as_ptr().cast()) };
    // The permutation looks at the lower three bits, the choice at the sign: the fourth bit.
    let is_second = _mm256_castsi256_ps(_mm256_slli_epi32::<28>(places));
    _mm256_blendv_ps(
        _mm256_permutevar8x32_ps(first, places),
        _mm256_permutevar8x32_ps(second, places),
        is_second,
    )
}

#[target_feature(enable = "avx2")]
#[inline]
fn load(floats: &[f32; 8]) -> __m256 {
    // SAFETY: eight floats are there to be read.
    unsafe { _mm256_loadu_ps(floats.as_ptr()) }
}
