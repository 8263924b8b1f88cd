//! The published models that the command has built in: card and weights.

/// For any ball of known size.
pub const ANY: (&str, &[u8]) = (include_str!("../../models/any.json"), include_bytes!("../../models/any.safetensors"));
/// For the paper's scenes.
pub const SD_L: (&str, &[u8]) =
    (include_str!("../../models/sd-l.json"), include_bytes!("../../models/sd-l.safetensors"));
