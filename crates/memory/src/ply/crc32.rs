//! CRC-32 as in zlib, PNG and Ethernet (reflected polynomial 0xEDB88320), eight bytes at a time.

/// `TABLES[k][b]`: the checksum's change by byte `b` followed by `k` zero bytes.
static TABLES: [[u32; 256]; 8] = tables();

const fn tables() -> [[u32; 256]; 8] {
    let mut tables = [[0; 256]; 8];
    let mut byte = 0;
    while byte < 256 {
        let mut crc = byte as u32;
        let mut bit = 0;
        while bit < 8 {
            crc = (crc >> 1) ^ (0xedb8_8320 & (crc & 1).wrapping_neg());
            bit += 1;
        }
        tables[0][byte] = crc;
        byte += 1;
    }
    let mut index = 256;
    while index < 8 * 256 {
        let previous = tables[index / 256 - 1][index % 256];
        tables[index / 256][index % 256] = (previous >> 8) ^ tables[0][(previous & 0xff) as usize];
        index += 1;
    }
    tables
}

/// A checksum in the making.
#[derive(Clone, Copy)]
pub struct Crc32 {
    inverted: u32,
}

impl Crc32 {
    /// The checksum of nothing.
    pub fn new() -> Self {
        Self { inverted: u32::MAX }
    }

    /// Takes in more bytes.
    pub fn update(&mut self, bytes: &[u8]) {
        let entry = |table: usize, byte: u8| TABLES[table][usize::from(byte)];
        let (blocks, rest) = bytes.as_chunks::<8>();
        let mut crc = self.inverted;
        for &[a, b, c, d, e, f, g, h] in blocks {
            let [a, b, c, d] = (crc ^ u32::from_le_bytes([a, b, c, d])).to_le_bytes();
            let early = entry(7, a) ^ entry(6, b) ^ entry(5, c) ^ entry(4, d);
            crc = early ^ entry(3, e) ^ entry(2, f) ^ entry(1, g) ^ entry(0, h);
        }
        for &byte in rest {
            crc = (crc >> 8) ^ entry(0, crc as u8 ^ byte);
        }
        self.inverted = crc;
    }

    /// The checksum of all bytes so far.
    pub fn value(&self) -> u32 {
        !self.inverted
    }
}
