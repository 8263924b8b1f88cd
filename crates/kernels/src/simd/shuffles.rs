//! Bytes of pixels put in another order in wasm, by shuffles that LLVM does not find.

use std::arch::wasm32::{
    i8x16_shuffle, u8x16_avgr, u8x16_splat, u8x16_sub, v128, v128_and, v128_load, v128_not, v128_store, v128_xor,
};

fn load(bytes: &[u8; 16]) -> v128 {
    // SAFETY: 16 bytes, of any alignment.
    unsafe { v128_load(bytes.as_ptr().cast()) }
}

fn store(bytes: &mut [u8; 16], value: v128) {
    // SAFETY: 16 bytes, of any alignment.
    unsafe { v128_store(bytes.as_mut_ptr().cast(), value) }
}

/// [`levels`](crate::pixels::levels) of 16 pixels at a time. Returns the slices' ends, fewer than 16 pixels, that are left to do.
pub fn levels<'a>(
    rgb: &'a [u8],
    brightness: &'a mut [u8],
    colour: &'a mut [u8],
) -> (&'a [u8], &'a mut [u8], &'a mut [u8]) {
    // (a + b) / 2, rounded down.
    let half = |a, b| u8x16_sub(u8x16_avgr(a, b), v128_and(v128_xor(a, b), u8x16_splat(1)));
    let (pixels, rgb) = rgb.as_chunks::<48>();
    let ((bright, brightness), (off, colour)) = (brightness.as_chunks_mut::<16>(), colour.as_chunks_mut::<16>());
    for ((pixels, bright), off) in pixels.iter().zip(bright).zip(off) {
        let [a, b, c] = [0, 1, 2].map(|index| load(&pixels.as_chunks().0[index]));
        let red = i8x16_shuffle::<0, 3, 6, 9, 12, 15, 18, 21, 24, 27, 30, 0, 0, 0, 0, 0>(a, b);
        let red = i8x16_shuffle::<0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 17, 20, 23, 26, 29>(red, c);
        let green = i8x16_shuffle::<1, 4, 7, 10, 13, 16, 19, 22, 25, 28, 31, 0, 0, 0, 0, 0>(a, b);
        let green = i8x16_shuffle::<0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 18, 21, 24, 27, 30>(green, c);
        let blue = i8x16_shuffle::<2, 5, 8, 11, 14, 17, 20, 23, 26, 29, 0, 0, 0, 0, 0, 0>(a, b);
        let blue = i8x16_shuffle::<0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 16, 19, 22, 25, 28, 31>(blue, c);
        store(bright, half(half(red, blue), green));
        store(off, half(red, v128_not(blue)));
    }
    (rgb, brightness, colour)
}

/// [`rgb_of_rgba`](crate::pixels::rgb_of_rgba) of 16 pixels at a time. Returns the slices' ends, fewer than 16 pixels, that are left to do.
pub fn rgb_of_rgba<'a>(rgba: &'a [u8], rgb: &'a mut [u8], opaque: &mut u8) -> (&'a [u8], &'a mut [u8]) {
    let (four, rgba) = rgba.as_chunks::<64>();
    let (three, rgb) = rgb.as_chunks_mut::<48>();
    let mut all = u8x16_splat(u8::MAX);
    for (four, three) in four.iter().zip(three) {
        let [a, b, c, d] = [0, 1, 2, 3].map(|index| load(&four.as_chunks().0[index]));
        all = v128_and(all, v128_and(v128_and(a, b), v128_and(c, d)));
        let [first, second, third] = three.as_chunks_mut().0 else { unreachable!("48 bytes") };
        store(first, i8x16_shuffle::<0, 1, 2, 4, 5, 6, 8, 9, 10, 12, 13, 14, 16, 17, 18, 20>(a, b));
        store(second, i8x16_shuffle::<5, 6, 8, 9, 10, 12, 13, 14, 16, 17, 18, 20, 21, 22, 24, 25>(b, c));
        store(third, i8x16_shuffle::<10, 12, 13, 14, 16, 17, 18, 20, 21, 22, 24, 25, 26, 28, 29, 30>(c, d));
    }
    let mut bytes = [0; 16];
    store(&mut bytes, all);
    *opaque &= bytes[3] & bytes[7] & bytes[11] & bytes[15];
    (rgba, rgb)
}
