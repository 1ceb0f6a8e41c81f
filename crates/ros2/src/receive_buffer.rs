//! The kernel's limit for what may wait in a socket. A lost part of an image loses the image, or delays it.

/// Room for two images of 640 × 480 pixels in RGB.
const ENOUGH: u64 = 2 << 20;

/// Advice if the limit is too small for images; `None` also on systems other than Linux.
pub(crate) fn advice() -> Option<String> {
    let limit = std::fs::read_to_string("/proc/sys/net/core/rmem_max").ok()?.trim().parse::<u64>().ok()?;
    (limit < ENOUGH).then(|| {
        format!(
            "the receive buffer, {} KiB, is small for images, which may be lost: \
            sudo sysctl -w net.core.rmem_max=8388608",
            limit / 1024
        )
    })
}
