//! Arithmetic on pictures' bytes: what every pixel of a video's every frame goes through.

#[cfg(target_arch = "wasm32")]
use super::simd::shuffles;
use super::simd::vectorised;

/// The difference of two pixels' levels: a change of colour counts twice, since there is less of it.
#[inline(always)]
fn between(a: [u8; 2], b: [u8; 2]) -> u8 {
    a[0].abs_diff(b[0]).max(a[1].abs_diff(b[1]).saturating_mul(2))
}

vectorised! {
    /// Brightness and the difference of red and blue, 0 to 255, of RGB pixels.
    pub fn levels<'a>(rgb: &'a [u8], brightness: &'a mut [u8], colour: &'a mut [u8]) {
        #[cfg(target_arch = "wasm32")]
        let (rgb, brightness, colour) = shuffles::levels(rgb, brightness, colour);
        for ((brightness, colour), pixel) in brightness.iter_mut().zip(colour).zip(rgb.as_chunks::<3>().0) {
            let [red, green, blue] = pixel.map(u16::from);
            *brightness = ((red + 2 * green + blue) >> 2) as u8;
            *colour = ((255 + red - blue) >> 1) as u8;
        }
    }
}

vectorised! {
    /// The largest difference of each pixel's two levels in two pictures.
    pub fn differences<'a>(a: [&'a [u8]; 2], b: [&'a [u8]; 2], out: &'a mut [u8]) {
        let ([a, c], [b, d]) = (a, b);
        for ((out, (a, b)), (c, d)) in out.iter_mut().zip(a.iter().zip(b)).zip(c.iter().zip(d)) {
            *out = between([*a, *c], [*b, *d]);
        }
    }
}

vectorised! {
    /// The same of a background and a picture; the background then takes a step of one level towards the picture.
    pub fn differences_followed<'a>(background: [&'a mut [u8]; 2], now: [&'a [u8]; 2], out: &'a mut [u8]) {
        let ([a, c], [b, d]) = (background, now);
        for ((out, (a, b)), (c, d)) in out.iter_mut().zip(a.iter_mut().zip(b)).zip(c.iter_mut().zip(d)) {
            *out = between([*a, *c], [*b, *d]);
            *a = a.wrapping_add(u8::from(*b > *a)).wrapping_sub(u8::from(*b < *a));
            *c = c.wrapping_add(u8::from(*d > *c)).wrapping_sub(u8::from(*d < *c));
        }
    }
}

vectorised! {
    /// The less of two bytes.
    pub fn less<'a>(a: &'a [u8], b: &'a [u8], out: &'a mut [u8]) {
        for ((out, a), b) in out.iter_mut().zip(a).zip(b) {
            *out = *a.min(b);
        }
    }
}

vectorised! {
    /// The largest of each `run` bytes, the last run perhaps shorter.
    pub fn largest<'a>(values: &'a [u8], run: usize, out: &'a mut [u8]) {
        for (out, values) in out.iter_mut().zip(values.chunks(run)) {
            *out = values.iter().fold(0, |most, &value| value.max(most));
        }
    }
}

vectorised! {
    /// Adds how many bytes are above `least`.
    pub fn count_above<'a>(values: &'a [u8], least: u8, count: &'a mut usize) {
        // In bytes, many at once.
        for few in values.chunks(usize::from(u8::MAX)) {
            *count += usize::from(few.iter().fold(0_u8, |count, &value| count + u8::from(value > least)));
        }
    }
}

vectorised! {
    /// RGB of RGBA pixels, and all their alphas' common bits: 255 where all are opaque.
    pub fn rgb_of_rgba<'a>(rgba: &'a [u8], rgb: &'a mut [u8], alpha: &'a mut u8) {
        let mut opaque = u8::MAX;
        #[cfg(target_arch = "wasm32")]
        let (rgba, rgb) = shuffles::rgb_of_rgba(rgba, rgb, &mut opaque);
        for (to, [red, green, blue, alpha]) in rgb.as_chunks_mut::<3>().0.iter_mut().zip(rgba.as_chunks::<4>().0) {
            *to = [*red, *green, *blue];
            opaque &= alpha;
        }
        *alpha = opaque;
    }
}

#[cfg(test)]
mod tests {
    #[cfg(target_arch = "wasm32")]
    use wasm_bindgen_test::wasm_bindgen_test;

    use super::*;
    use crate::Vectors;

    fn bytes(seed: u32, count: usize) -> Vec<u8> {
        (0..count as u32).map(|index| ((index ^ seed).wrapping_mul(0x9e37_79b9) >> 11) as u8).collect()
    }

    #[cfg_attr(not(target_arch = "wasm32"), test)]
    #[cfg_attr(target_arch = "wasm32", wasm_bindgen_test)]
    fn every_set_of_vectors_does_what_the_words_say() {
        for vectors in Vectors::all() {
            // Lengths that fill no vector.
            for count in [1, 15, 64, 333] {
                let [a, b, c, d] = [1, 2, 3, 4].map(|seed| bytes(seed, count));
                let (mut brightness, mut colour) = (vec![0; count], vec![0; count]);
                let rgb = bytes(9, 3 * count);
                levels(vectors, &rgb, &mut brightness, &mut colour);
                for (index, pixel) in rgb.chunks(3).enumerate() {
                    let [red, green, blue] = [0, 1, 2].map(|channel| i32::from(pixel[channel]));
                    assert_eq!(i32::from(brightness[index]), (red + 2 * green + blue) / 4);
                    assert_eq!(i32::from(colour[index]), (255 + red - blue) / 2);
                }
                let expected = |index: usize| {
                    let off = |x: &[u8], y: &[u8]| (i32::from(x[index]) - i32::from(y[index])).abs();
                    off(&a, &b).max(2 * off(&c, &d)).min(255) as u8
                };
                let expected: Vec<u8> = (0..count).map(expected).collect();
                let mut out = vec![0; count];
                differences(vectors, [&a, &c], [&b, &d], &mut out);
                assert_eq!(out, expected);
                let (mut background, mut other) = (a.clone(), c.clone());
                out.fill(0);
                differences_followed(vectors, [&mut background, &mut other], [&b, &d], &mut out);
                assert_eq!(out, expected);
                for (was, (is, now)) in
                    a.iter().zip(background.iter().zip(&b)).chain(c.iter().zip(other.iter().zip(&d)))
                {
                    assert_eq!(i32::from(*is) - i32::from(*was), (i32::from(*now) - i32::from(*was)).signum());
                }
                less(vectors, &a, &b, &mut out);
                assert!((0..count).all(|index| out[index] == a[index].min(b[index])));
                let mut most = vec![0; count.div_ceil(64)];
                largest(vectors, &a, 64, &mut most);
                assert!(a.chunks(64).zip(&most).all(|(few, most)| few.iter().max() == Some(most)));
                let mut above = 7;
                count_above(vectors, &a, 100, &mut above);
                assert_eq!(above, 7 + a.iter().filter(|value| **value > 100).count());
                let (mut three, mut alpha) = (vec![0; 3 * count], 0);
                let four = bytes(5, 4 * count);
                rgb_of_rgba(vectors, &four, &mut three, &mut alpha);
                assert!(three.chunks(3).zip(four.chunks(4)).all(|(three, four)| three == &four[..3]));
                assert_eq!(alpha, four.chunks(4).fold(255, |all, pixel| all & pixel[3]));
            }
        }
    }
}
