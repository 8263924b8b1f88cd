//! The browser's boundary: an opaque handle, plain objects in and out, no arithmetic.

mod fine_tuner;
mod held;
mod labels;
mod localiser;
mod simulator;
mod tools;

use std::cell::RefCell;

use js_sys::{Object, Reflect};
use serde::Serialize;
use wasm_bindgen::prelude::{JsCast as _, JsValue, wasm_bindgen};

use crate::error::{Error, Result};

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

/// What the code said when it trapped; empty if it did not.
#[wasm_bindgen(js_name = lastPanic)]
pub fn last_panic() -> String {
    LAST_PANIC.with(|last| last.borrow().clone())
}

/// A JavaScript `Error` with the text and [`Error::code`].
fn js_error(error: Error) -> JsValue {
    let object = js_sys::Error::new(&error.to_string());
    object.set_name(ERROR_NAME);
    set(&object, "code", &JsValue::from_str(error.code()));
    object.into()
}

/// Sets a property of a fresh, extensible object, which cannot fail.
fn set(object: &JsValue, key: &str, value: &JsValue) {
    Reflect::set(object.unchecked_ref::<Object>(), &JsValue::from_str(key), value).ok();
}

/// A plain JavaScript object (no `Map`) of anything that serialises.
fn object_of(value: &impl Serialize) -> Result<JsValue> {
    let serialiser = serde_wasm_bindgen::Serializer::json_compatible();
    value.serialize(&serialiser).map_err(Error::format("result"))
}
