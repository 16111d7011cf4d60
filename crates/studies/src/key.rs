//! Names of folders from texts.

/// Hash of a text: CRC-32 of the bytes and of the reversed bytes, as 16 hexadecimal digits.
pub(crate) fn key_of(text: &str) -> String {
    let reversed: Vec<u8> = text.bytes().rev().collect();
    format!("{:08x}{:08x}", crc32fast::hash(text.as_bytes()), crc32fast::hash(&reversed))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hashes_of_different_texts_differ() {
        assert_ne!(key_of("a = 1"), key_of("a = 2"));
        assert_eq!(key_of("x").len(), 16);
    }
}
