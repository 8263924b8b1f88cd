mod golden;
mod laws;
mod odd;
mod scenes;
mod turned;
