//! Zip archives: the same bytes for the same files, whenever and wherever they are written.

/// Date and time of every file, the first that a zip archive can name: 1 January 1980.
const DATE: u16 = 0x21;

/// Version of the format that is needed to unpack.
const VERSION: u16 = 20;

/// Compression by deflate.
const DEFLATE: u16 = 8;

/// Names are in UTF-8.
const FLAGS: u16 = 0x0800;

/// An archive of files by their paths.
pub(super) fn zip(files: &[(String, Vec<u8>)]) -> Vec<u8> {
    let (mut out, mut directory) = (Vec::new(), Vec::new());
    for (path, bytes) in files {
        let packed = miniz_oxide::deflate::compress_to_vec(bytes, 6);
        let at = out.len() as u32;
        let mut common = Vec::new();
        [VERSION, FLAGS, DEFLATE, 0, DATE].iter().for_each(|x| common.extend(x.to_le_bytes()));
        [checksum(bytes), packed.len() as u32, bytes.len() as u32].iter().for_each(|x| common.extend(x.to_le_bytes()));
        [path.len() as u16, 0].iter().for_each(|x| common.extend(x.to_le_bytes()));
        out.extend(b"PK\x03\x04");
        out.extend(&common);
        out.extend(path.as_bytes());
        out.extend(packed);
        directory.extend(b"PK\x01\x02");
        directory.extend(VERSION.to_le_bytes());
        directory.extend(common);
        // No comment, first disk, no attributes.
        directory.extend([0; 10]);
        directory.extend(at.to_le_bytes());
        directory.extend(path.as_bytes());
    }
    let (start, length, count) = (out.len() as u32, directory.len() as u32, files.len() as u16);
    out.extend(directory);
    out.extend(b"PK\x05\x06\0\0\0\0");
    [count, count].iter().for_each(|x| out.extend(x.to_le_bytes()));
    [length, start].iter().for_each(|x| out.extend(x.to_le_bytes()));
    out.extend([0, 0]);
    out
}

/// The cyclic redundancy check of zip archives (ISO 3309).
fn checksum(bytes: &[u8]) -> u32 {
    let table: [u32; 256] =
        std::array::from_fn(|byte| (0..8).fold(byte as u32, |rest, _| if rest & 1 == 1 { 0xEDB8_8320 ^ (rest >> 1) } else { rest >> 1 }));
    !bytes.iter().fold(u32::MAX, |rest, &byte| table[((rest ^ u32::from(byte)) & 0xFF) as usize] ^ (rest >> 8))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_is_that_of_the_catalogue() {
        // The check value of CRC-32/ISO-HDLC.
        assert_eq!(checksum(b"123456789"), 0xCBF4_3926);
    }
}
