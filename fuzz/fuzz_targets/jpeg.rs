//! The JPEG decoder.
#![no_main]

use libfuzzer_sys::fuzz_target;
use splatseg_fuzz as _; // its limit on memory
use splatseg_jpeg::Jpeg;

fuzz_target!(|bytes: &[u8]| {
    let Ok(jpeg) = Jpeg::read_header(bytes) else { return };
    let (width, height) = jpeg.size();
    // Callers check the size, as the documentation asks.
    if u64::from(width) * u64::from(height) <= 1 << 20
        && let Ok(pixels) = jpeg.decode()
    {
        assert_eq!(pixels.len(), width as usize * height as usize);
    }
});
