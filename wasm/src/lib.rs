//! The browser's boundary: opaque handles, plain objects in and out, no arithmetic.
//!
//! What is declared here is the package's: wasm-bindgen writes it into the build's `.d.ts`, comments included, from which
//! the package takes its types. Fields are camelCase, except in what is a file's content (camera, scene, card).

#![cfg(target_arch = "wasm32")]
#![deny(missing_docs, unsafe_code)]
#![warn(clippy::unwrap_used)]

mod adapter;
mod cameras;
mod device;
mod fine_tuner;
mod held;
mod localiser;
mod physics;
mod picture;
mod simulator;
#[cfg(feature = "threads")]
mod threads;
mod tracker;

use std::cell::RefCell;

use js_sys::{Object, Reflect};
use serde::Serialize;
use tsify::{Ts, Tsify};
use wasm_bindgen::prelude::{JsCast as _, JsValue, wasm_bindgen};

use gravisight_geometry::error::{Error, Result};

/// What vectors, matrices and surfaces serialise as.
#[wasm_bindgen(typescript_custom_section)]
const TYPES: &str = r#"
/** Of a picture, pixels. */
export type Point2<T> = [T, T];
/** Of a picture, pixels. */
export type Vector2<T> = [T, T];
/** Of a frame in space, metres. */
export type Point3<T> = [T, T, T];
/** Along the axes of a frame in space. */
export type Vector3<T> = [T, T, T];
/** By row. */
export type Matrix3<T> = [Vector3<T>, Vector3<T>, Vector3<T>];
/** What a ball touches, as the scene names it. */
export type Surface = "floor" | `walls[${number}]` | `boxes[${number}]`;
"#;

/// Name of the JavaScript errors.
const ERROR_NAME: &str = "GravisightError";

thread_local! {
    /// The last panic's message: a trap itself carries none.
    static LAST_PANIC: RefCell<String> = const { RefCell::new(String::new()) };
}

#[wasm_bindgen(start)]
fn start() {
    std::panic::set_hook(Box::new(|info| LAST_PANIC.with(|last| *last.borrow_mut() = info.to_string())));
}

/// The panic's message after a trap, once; empty if there was none.
#[wasm_bindgen(js_name = lastPanic)]
pub fn last_panic() -> String {
    LAST_PANIC.take()
}

/// A JavaScript `Error` with the text and [`Error::code`].
fn js_error(error: Error) -> JsValue {
    let object = js_sys::Error::new(&error.to_string());
    object.set_name(ERROR_NAME);
    // A fresh, extensible object: this cannot fail.
    Reflect::set(object.unchecked_ref::<Object>(), &"code".into(), &error.code().into()).ok();
    object.into()
}

/// A plain JavaScript object of the type that is declared for `T`.
fn object_of<T: Serialize + Tsify>(value: &T) -> Result<Ts<T>> {
    value.into_ts().map_err(Error::format("result"))
}

/// The same for what has no declaration of its own.
fn untyped(value: &impl Serialize) -> Result<JsValue> {
    let serialiser = serde_wasm_bindgen::Serializer::json_compatible();
    value.serialize(&serialiser).map_err(Error::format("result"))
}
