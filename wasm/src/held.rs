//! Pictures that wait in the browser's memory.

use wasm_bindgen::prelude::JsValue;

use super::js_error;
use gravisight_geometry::error::{Error, Result};
use gravisight_geometry::image::Picture;

/// Bytes of pictures at most: wasm's memory ends at 4 GiB, and what is made of the pictures needs room, too.
pub(super) const MOST_BYTES: usize = 1 << 30;

/// The pictures of the clip that is being given.
#[derive(Default)]
pub(super) struct Held {
    pictures: Vec<Picture>,
    /// Bytes of earlier clips' pictures, which are still in use.
    earlier: usize,
}

impl Held {
    /// One more. After an error none is left, so that the next clip starts afresh.
    pub(super) fn add(&mut self, picture: Result<Picture>) -> std::result::Result<(), JsValue> {
        let added = picture.and_then(|picture| {
            self.pictures.push(picture);
            let bytes = self.earlier + bytes_of(&self.pictures);
            if bytes > MOST_BYTES {
                let reason = format!(
                    "take {} MB, but a browser can hold only {} MB: give fewer frames, or smaller ones and a camera to match",
                    bytes >> 20,
                    MOST_BYTES >> 20
                );
                return Err(Error::Data { what: "the pictures".into(), reason });
            }
            Ok(())
        });
        if added.is_err() {
            self.forget();
        }
        added.map_err(js_error)
    }

    /// Forgets the clip's.
    pub(super) fn forget(&mut self) {
        self.pictures.clear();
    }

    /// Uses the clip's pictures; where that succeeds they count as still in use.
    pub(super) fn use_up<T>(&mut self, with: impl FnOnce(Vec<Picture>) -> Result<T>) -> Result<T> {
        let pictures = std::mem::take(&mut self.pictures);
        let bytes = bytes_of(&pictures);
        let made = with(pictures)?;
        self.earlier += bytes;
        Ok(made)
    }
}

fn bytes_of(pictures: &[Picture]) -> usize {
    pictures.iter().map(|picture| picture.rgb().len()).sum()
}
