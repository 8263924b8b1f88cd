//! Pictures as browsers hold them.

use std::cell::RefCell;

use js_sys::{ArrayBuffer, Object, Reflect, Uint8Array};
use wasm_bindgen::prelude::{JsCast, JsValue, wasm_bindgen};
use wasm_bindgen_futures::JsFuture;
use web_sys::{
    Blob, ColorSpaceConversion, ImageBitmap, ImageBitmapOptions, OffscreenCanvas, OffscreenCanvasRenderingContext2d,
};

use super::device::scope;
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::image::Picture;
use gravisight_geometry::size::Size;

#[wasm_bindgen(typescript_custom_section)]
const DECLARATIONS: &str = r#"
/** RGBA pixels, row-major: an `ImageData`, or what looks like one. */
export interface Pixels {
    /** RGBA, row by row, 4 · width · height bytes. */
    data: Uint8ClampedArray | Uint8Array;
    /** Pixels. */
    width: number;
    /** Pixels. */
    height: number;
}

/** What a browser can draw. */
export type DrawablePicture =
    | ImageBitmap
    | HTMLCanvasElement
    | HTMLVideoElement
    | HTMLImageElement
    | OffscreenCanvas
    | VideoFrame;

/**
 * A picture. Encoded bytes (PNG, JPEG or WebP in a `Blob`, `ArrayBuffer` or `Uint8Array`) are decoded by the core
 * itself, so that every browser and the command line agree; anything else is drawn to pixels first.
 */
export type Picture = Blob | ArrayBuffer | Uint8Array | Pixels | DrawablePicture;
"#;

#[wasm_bindgen]
extern "C" {
    /// A picture in any form that a browser has.
    #[wasm_bindgen(typescript_type = "Picture")]
    pub type AnyPicture;
}

/// One canvas for all frames: a new one each would be kept until the next garbage collection.
struct Canvas {
    size: Size,
    context: OffscreenCanvasRenderingContext2d,
}

thread_local! {
    static CANVAS: RefCell<Option<Canvas>> = const { RefCell::new(None) };
}

/// Decodes or draws `picture`, which stays the caller's.
///
/// # Errors
/// [`Error::ImageRead`] for a file that cannot be read, and for what the browser cannot draw; those of [`Picture::decode`] and
/// [`Picture::from_rgba`].
pub(super) async fn read(picture: &AnyPicture) -> Result<Picture> {
    if let Some(bytes) = encoded(picture).await? {
        return Picture::decode(&bytes.to_vec());
    }
    let (rgba, size) = match pixels(picture) {
        Some(pixels) => pixels,
        None => drawn(picture).await.map_err(unreadable("the picture could not be drawn to pixels"))?,
    };
    Picture::from_rgba_copied(rgba.length() as usize, size, |from, part| {
        rgba.subarray(from as u32, (from + part.len()) as u32).copy_to(part);
    })
}

/// The bytes of a file. Views are told by what they are, not by their class, of which each frame of a page has its own.
async fn encoded(picture: &JsValue) -> Result<Option<Uint8Array>> {
    if let Some(blob) = picture.dyn_ref::<Blob>() {
        let read =
            JsFuture::from(blob.array_buffer()).await.map_err(unreadable("the picture's file could not be read"))?;
        return Ok(Some(Uint8Array::new(&read)));
    }
    if let Some(buffer) = picture.dyn_ref::<ArrayBuffer>() {
        return Ok(Some(part_of(buffer, 0, buffer.byte_length())));
    }
    Ok(bytes_of(picture))
}

/// What looks like an `ImageData`.
fn pixels(picture: &JsValue) -> Option<(Uint8Array, Size)> {
    let rgba = bytes_of(&property(picture, "data")?)?;
    let side = |name| property(picture, name)?.as_f64().map(|side| side as u32);
    Some((rgba, Size { width: side("width")?, height: side("height")? }))
}

/// The bytes of a typed array, not copied.
fn bytes_of(view: &JsValue) -> Option<Uint8Array> {
    let view = ArrayBuffer::is_view(view).then(|| view.unchecked_ref::<Uint8Array>())?;
    Some(part_of(&view.buffer(), view.byte_offset(), view.byte_length()))
}

/// Bytes of a buffer. One that was sent away says that it has none, and no view of it can be made.
fn part_of(buffer: &ArrayBuffer, offset: u32, length: u32) -> Uint8Array {
    match length {
        0 => Uint8Array::new_with_length(0),
        _ => Uint8Array::new_with_byte_offset_and_length(buffer, offset, length),
    }
}

/// What the browser draws of `picture`: RGBA pixels, row-major.
async fn drawn(picture: &JsValue) -> std::result::Result<(Uint8Array, Size), JsValue> {
    if let Some(bitmap) = picture.dyn_ref::<ImageBitmap>() {
        return pixels_of(bitmap);
    }
    let scope = scope();
    if !property(&scope, "createImageBitmap").is_some_and(|method| method.is_function()) {
        let reason = "there is no browser here; give a PNG, JPEG or WebP file's bytes, or { data, width, height }";
        return Err(js_sys::Error::new(reason).into());
    }
    let options = ImageBitmapOptions::new();
    // Without conversion to the screen's colours: files are decoded without one, too.
    options.set_color_space_conversion(ColorSpaceConversion::None);
    // Whatever the picture is, the browser knows whether it can draw it.
    let made =
        scope.create_image_bitmap_with_video_frame_and_image_bitmap_options(picture.unchecked_ref(), &options)?;
    let bitmap: ImageBitmap = JsFuture::from(made).await?.unchecked_into();
    let read = pixels_of(&bitmap);
    bitmap.close();
    read
}

fn pixels_of(bitmap: &ImageBitmap) -> std::result::Result<(Uint8Array, Size), JsValue> {
    let size = Size { width: bitmap.width(), height: bitmap.height() };
    let [width, height] = size.xy();
    CANVAS.with_borrow_mut(|kept| {
        let Canvas { context, .. } = match kept.take().filter(|kept| kept.size == size) {
            Some(canvas) => kept.insert(canvas),
            None => kept.insert(Canvas { size, context: context_of(size)? }),
        };
        context.clear_rect(0.0, 0.0, width, height);
        context.draw_image_with_image_bitmap(bitmap, 0.0, 0.0)?;
        let shown = context.get_image_data(0.0, 0.0, width, height)?;
        // web-sys' `data` would copy it.
        let rgba = bytes_of(&Reflect::get(&shown, &"data".into())?);
        Ok((rgba.ok_or_else(|| js_sys::Error::new("this browser gives no pixels here"))?, size))
    })
}

fn context_of(size: Size) -> std::result::Result<OffscreenCanvasRenderingContext2d, JsValue> {
    let options = Object::new();
    Reflect::set(&options, &"willReadFrequently".into(), &true.into())?;
    let canvas = OffscreenCanvas::new(size.width, size.height)?;
    let context = canvas.get_context_with_context_options("2d", &options)?;
    let context = context.ok_or_else(|| js_sys::Error::new("this browser gives no 2D canvas here"))?;
    Ok(context.unchecked_into())
}

fn property(object: &JsValue, name: &str) -> Option<JsValue> {
    Reflect::get(object, &name.into()).ok()
}

/// An [`Error::ImageRead`] with what the browser threw, for `map_err`.
fn unreadable(what: &'static str) -> impl FnOnce(JsValue) -> Error {
    move |thrown| {
        let cause = property(&thrown, "message").and_then(|message| message.as_string());
        Error::ImageRead { what, cause: cause.unwrap_or_else(|| "the browser does not say why".into()) }
    }
}
