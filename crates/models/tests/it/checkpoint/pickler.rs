//! Writes pickles piece by piece, both like PyTorch's and unlike them.

/// A piece of a pickle that leaves one value on the stack.
pub type Piece = Vec<u8>;

/// A complete pickle of protocol 2.
pub fn pickle(piece: &[u8]) -> Vec<u8> {
    [&[0x80, 2], piece, b"."].concat()
}

pub fn none() -> Piece {
    b"N".to_vec()
}

pub fn text(text: &str) -> Piece {
    [b"X", &(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat()
}

pub fn int(value: i64) -> Piece {
    [&[0x8a, 8], &value.to_le_bytes()[..]].concat()
}

pub fn float(value: f64) -> Piece {
    [b"G", &value.to_be_bytes()[..]].concat()
}

pub fn tuple(items: &[Piece]) -> Piece {
    [b"(", &items.concat()[..], b"t"].concat()
}

pub fn ints(items: &[i64]) -> Piece {
    tuple(&items.iter().copied().map(int).collect::<Vec<_>>())
}

pub fn list(items: &[Piece]) -> Piece {
    [b"](", &items.concat()[..], b"e"].concat()
}

pub fn dict(entries: &[(&str, Piece)]) -> Piece {
    let entries: Vec<u8> = entries.iter().flat_map(|(key, value)| [text(key), value.clone()].concat()).collect();
    [b"}(", &entries[..], b"u"].concat()
}

pub fn global(module: &str, name: &str) -> Piece {
    format!("c{module}\n{name}\n").into_bytes()
}

/// A call of a function with arguments.
pub fn call(module: &str, name: &str, arguments: &[Piece]) -> Piece {
    [global(module, name), tuple(arguments), b"R".to_vec()].concat()
}

/// Instantiates a class and sets its attributes.
pub fn object(module: &str, class: &str, state: Piece) -> Piece {
    [global(module, class), b")\x81".to_vec(), state, b"b".to_vec()].concat()
}

/// Stores the value in the memo.
pub fn memoized(piece: Piece, slot: u8) -> Piece {
    [piece, vec![b'q', slot]].concat()
}

/// Loads the value from the memo.
pub fn recalled(slot: u8) -> Piece {
    vec![b'h', slot]
}

pub fn ordered_dict(entries: &[(&str, Piece)]) -> Piece {
    let entries: Vec<u8> = entries.iter().flat_map(|(key, value)| [text(key), value.clone()].concat()).collect();
    [call("collections", "OrderedDict", &[]), b"(".to_vec(), entries, b"u".to_vec()].concat()
}

pub fn storage(class: &str, key: &str, elements: i64) -> Piece {
    let reference = [text("storage"), global("torch", class), text(key), text("cpu"), int(elements)];
    [tuple(&reference), b"Q".to_vec()].concat()
}

pub fn tensor(storage: Piece, offset: i64, shape: &[i64], strides: &[i64]) -> Piece {
    let requires_grad = b"\x89".to_vec();
    let arguments = [storage, int(offset), ints(shape), ints(strides), requires_grad, ordered_dict(&[])];
    call("torch._utils", "_rebuild_tensor_v2", &arguments)
}

pub fn parameter(tensor: Piece) -> Piece {
    call("torch._utils", "_rebuild_parameter", &[tensor, b"\x88".to_vec(), ordered_dict(&[])])
}

/// A module with its three tables, and other attributes.
pub fn module(
    class: &str,
    parameters: &[(&str, Piece)],
    buffers: &[(&str, Piece)],
    modules: &[(&str, Piece)],
    more: &[(&str, Piece)],
) -> Piece {
    let tables = [("_parameters", dict(parameters)), ("_buffers", ordered_dict(buffers)), ("_modules", dict(modules))];
    object("some.nn", class, dict(&[&tables[..], more].concat()))
}
