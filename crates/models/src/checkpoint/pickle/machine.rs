//! The stack machine that reads a pickle.

use super::{Graph, Id, Object, PickleError, Value, opcode};
use std::collections::HashMap;

/// Maximum number of values, memo entries and stack slots; the largest checkpoints have a tenth of it. Together with
/// the limit on the pickle's length, it bounds the graph at about 100 MB.
const MAX_VALUES: usize = 1 << 19;
/// The newest pickle protocol.
const MAX_PROTOCOL: u8 = 5;

/// Parses a pickle. Memory use depends only on its length; see [`MAX_VALUES`].
pub fn parse(bytes: &[u8]) -> Result<Graph<'_>, PickleError> {
    let mut machine =
        Machine { bytes, position: 0, values: Vec::new(), stack: Vec::new(), marks: Vec::new(), memo: HashMap::new() };
    loop {
        let start = machine.position;
        let code = machine.byte()?;
        if code == opcode::STOP {
            let root = machine.pop()?;
            return Ok(Graph { values: machine.values, root });
        }
        if !machine.scalar(code)? && !machine.collection(code)? && !machine.object(code)? && !machine.memory(code)? {
            return Err(PickleError {
                offset: start,
                found: format!("the opcode {code:#04x}"),
                expected: "one that checkpoints use",
            });
        }
    }
}

struct Machine<'a> {
    bytes: &'a [u8],
    position: usize,
    values: Vec<Value<'a>>,
    stack: Vec<Id>,
    /// Stack heights of the marks.
    marks: Vec<usize>,
    memo: HashMap<u32, Id>,
}

impl<'a> Machine<'a> {
    /// Numbers, strings and names. Returns false if the opcode is in another group; so do the next three functions.
    fn scalar(&mut self, code: u8) -> Result<bool, PickleError> {
        let value = match code {
            opcode::NONE => Value::None,
            opcode::NEWTRUE => Value::Bool(true),
            opcode::NEWFALSE => Value::Bool(false),
            opcode::BININT => Value::Int(i32::from_le_bytes(self.array()?).into()),
            opcode::BININT1 => Value::Int(self.byte()?.into()),
            opcode::BININT2 => Value::Int(u16::from_le_bytes(self.array()?).into()),
            opcode::LONG1 => {
                let len = self.byte()?.into();
                self.long(len)?
            }
            opcode::LONG4 => {
                let len = self.length4()?;
                self.long(len)?
            }
            opcode::BINFLOAT => Value::Float(f64::from_be_bytes(self.array()?)),
            opcode::SHORT_BINUNICODE => {
                let len = self.byte()?.into();
                self.unicode(len)?
            }
            opcode::BINUNICODE => {
                let len = self.length4()?;
                self.unicode(len)?
            }
            opcode::BINUNICODE8 => {
                let len = self.length8()?;
                self.unicode(len)?
            }
            opcode::SHORT_BINSTRING => {
                let len = self.byte()?.into();
                self.python2_text(len)?
            }
            opcode::BINSTRING => {
                let len = self.length4()?;
                self.python2_text(len)?
            }
            opcode::SHORT_BINBYTES => {
                let len = self.byte()?.into();
                self.blob(len)?
            }
            opcode::BINBYTES => {
                let len = self.length4()?;
                self.blob(len)?
            }
            opcode::BINBYTES8 | opcode::BYTEARRAY8 => {
                let len = self.length8()?;
                self.blob(len)?
            }
            opcode::GLOBAL => Value::Global { module: self.line()?, name: self.line()? },
            opcode::STACK_GLOBAL => {
                let (name, module) = (self.pop_text()?, self.pop_text()?);
                Value::Global { module, name }
            }
            _ => return Ok(false),
        };
        self.push_new(value)?;
        Ok(true)
    }

    fn collection(&mut self, code: u8) -> Result<bool, PickleError> {
        let value = match code {
            opcode::EMPTY_TUPLE => Value::Tuple(Vec::new()),
            opcode::EMPTY_LIST => Value::List(Vec::new()),
            opcode::EMPTY_DICT => Value::Dict(Vec::new()),
            opcode::EMPTY_SET => Value::Set(Vec::new()),
            opcode::TUPLE1 => Value::Tuple(self.pop_many(1)?),
            opcode::TUPLE2 => Value::Tuple(self.pop_many(2)?),
            opcode::TUPLE3 => Value::Tuple(self.pop_many(3)?),
            opcode::TUPLE => Value::Tuple(self.pop_to_mark()?),
            opcode::LIST => Value::List(self.pop_to_mark()?),
            opcode::FROZENSET => Value::Set(self.pop_to_mark()?),
            opcode::DICT => Value::Dict(self.pop_pairs()?),
            opcode::APPEND => {
                let item = self.pop()?;
                return self.add_items(&[item]);
            }
            opcode::APPENDS | opcode::ADDITEMS => {
                let items = self.pop_to_mark()?;
                return self.add_items(&items);
            }
            opcode::SETITEM => {
                let (value, key) = (self.pop()?, self.pop()?);
                return self.add_entries(&[(key, value)]);
            }
            opcode::SETITEMS => {
                let pairs = self.pop_pairs()?;
                return self.add_entries(&pairs);
            }
            _ => return Ok(false),
        };
        self.push_new(value)?;
        Ok(true)
    }

    fn object(&mut self, code: u8) -> Result<bool, PickleError> {
        match code {
            opcode::REDUCE | opcode::NEWOBJ => {
                let (arguments, callable) = (self.pop()?, self.pop()?);
                self.push_object(callable, arguments)?;
            }
            opcode::NEWOBJ_EX => {
                let (_keywords, arguments, callable) = (self.pop()?, self.pop()?, self.pop()?);
                self.push_object(callable, arguments)?;
            }
            opcode::BUILD => {
                let state = self.pop()?;
                // Only objects have attributes; other values are left unchanged.
                if let Value::Object(object) = self.top()? {
                    object.state = Some(state);
                }
            }
            opcode::BINPERSID => {
                let reference = self.pop()?;
                self.push_new(Value::Persistent(reference))?;
            }
            _ => return Ok(false),
        }
        Ok(true)
    }

    /// Stack, memo and framing.
    fn memory(&mut self, code: u8) -> Result<bool, PickleError> {
        match code {
            opcode::MARK => {
                if self.marks.len() >= MAX_VALUES {
                    return Err(self.error("more marks than in any checkpoint", "fewer"));
                }
                self.marks.push(self.stack.len());
            }
            opcode::POP => {
                // A mark is popped like a value.
                if self.marks.last() == Some(&self.stack.len()) {
                    self.marks.pop();
                } else {
                    self.pop()?;
                }
            }
            opcode::POP_MARK => drop(self.pop_to_mark()?),
            opcode::DUP => {
                let id = self.top_id()?;
                self.push(id)?;
            }
            opcode::BINGET => {
                let slot = self.byte()?.into();
                self.recall(slot)?;
            }
            opcode::LONG_BINGET => {
                let slot = u32::from_le_bytes(self.array()?);
                self.recall(slot)?;
            }
            opcode::BINPUT => {
                let slot = self.byte()?.into();
                self.memoize(slot)?;
            }
            opcode::LONG_BINPUT => {
                let slot = u32::from_le_bytes(self.array()?);
                self.memoize(slot)?;
            }
            // The memo has at most `MAX_VALUES` entries.
            opcode::MEMOIZE => self.memoize(self.memo.len() as u32)?,
            opcode::PROTO => {
                let version = self.byte()?;
                if version > MAX_PROTOCOL {
                    return Err(self.error(format!("pickle protocol {version}"), "at most 5"));
                }
            }
            opcode::FRAME => drop(self.array::<8>()?),
            _ => return Ok(false),
        }
        Ok(true)
    }

    fn error(&self, found: impl Into<String>, expected: &'static str) -> PickleError {
        PickleError { offset: self.position, found: found.into(), expected }
    }

    fn take(&mut self, len: usize) -> Result<&'a [u8], PickleError> {
        let rest = &self.bytes[self.position..];
        let taken = rest
            .get(..len)
            .ok_or_else(|| self.error(format!("{} bytes left instead of {len}", rest.len()), "a complete pickle"))?;
        self.position += len;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], PickleError> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N)?);
        Ok(array)
    }

    fn byte(&mut self) -> Result<u8, PickleError> {
        let [byte] = self.array()?;
        Ok(byte)
    }

    /// Reads a 4-byte length; a value that does not fit `usize` exceeds any pickle.
    fn length4(&mut self) -> Result<usize, PickleError> {
        Ok(usize::try_from(u32::from_le_bytes(self.array()?)).unwrap_or(usize::MAX))
    }

    fn length8(&mut self) -> Result<usize, PickleError> {
        Ok(usize::try_from(u64::from_le_bytes(self.array()?)).unwrap_or(usize::MAX))
    }

    fn utf8(&self, bytes: &'a [u8]) -> Result<&'a str, PickleError> {
        std::str::from_utf8(bytes).map_err(|_| self.error("a string that is not UTF-8", "UTF-8"))
    }

    fn unicode(&mut self, len: usize) -> Result<Value<'a>, PickleError> {
        let bytes = self.take(len)?;
        Ok(Value::Text(self.utf8(bytes)?))
    }

    /// Reads a Python 2 `str`, which may be text or arbitrary bytes.
    fn python2_text(&mut self, len: usize) -> Result<Value<'a>, PickleError> {
        Ok(std::str::from_utf8(self.take(len)?).map_or(Value::Bytes, Value::Text))
    }

    fn blob(&mut self, len: usize) -> Result<Value<'a>, PickleError> {
        self.take(len)?;
        Ok(Value::Bytes)
    }

    /// Reads a little-endian two's-complement integer of any length.
    fn long(&mut self, len: usize) -> Result<Value<'a>, PickleError> {
        let bytes = self.take(len)?;
        if bytes.len() > 8 {
            return Ok(Value::BigInt);
        }
        let negative = bytes.last().is_some_and(|byte| byte & 0x80 != 0);
        let mut extended = [if negative { 0xff } else { 0 }; 8];
        extended[..bytes.len()].copy_from_slice(bytes);
        Ok(Value::Int(i64::from_le_bytes(extended)))
    }

    fn line(&mut self) -> Result<&'a str, PickleError> {
        let rest = &self.bytes[self.position..];
        let len = rest.iter().position(|&byte| byte == b'\n');
        let len = len.ok_or_else(|| self.error("an unterminated name", "a line"))?;
        let line = self.take(len + 1)?;
        self.utf8(&line[..len])
    }

    fn push(&mut self, id: Id) -> Result<(), PickleError> {
        if self.stack.len() >= MAX_VALUES {
            return Err(self.error("more stack slots than any checkpoint has", "fewer"));
        }
        self.stack.push(id);
        Ok(())
    }

    fn push_new(&mut self, value: Value<'a>) -> Result<(), PickleError> {
        if self.values.len() >= MAX_VALUES {
            return Err(self.error("more values than any checkpoint has", "fewer"));
        }
        self.values.push(value);
        // Cannot truncate: there are at most `MAX_VALUES` values.
        self.push((self.values.len() - 1) as Id)
    }

    fn push_object(&mut self, callable: Id, arguments: Id) -> Result<(), PickleError> {
        self.push_new(Value::Object(Box::new(Object { callable, arguments, state: None, entries: Vec::new() })))
    }

    /// The stack height below which nothing may be popped.
    fn floor(&self) -> usize {
        self.marks.last().copied().unwrap_or(0)
    }

    fn pop(&mut self) -> Result<Id, PickleError> {
        let id = self.top_id()?;
        self.stack.pop();
        Ok(id)
    }

    fn pop_text(&mut self) -> Result<&'a str, PickleError> {
        let id = self.pop()?;
        match &self.values[id as usize] {
            Value::Text(text) => Ok(text),
            _ => Err(self.error("a name of another type", "text")),
        }
    }

    fn pop_many(&mut self, count: usize) -> Result<Vec<Id>, PickleError> {
        if self.stack.len() < self.floor() + count {
            return Err(self.error("an empty stack", "a value on it"));
        }
        Ok(self.stack.drain(self.stack.len() - count..).collect())
    }

    fn pop_to_mark(&mut self) -> Result<Vec<Id>, PickleError> {
        let height = self.marks.pop().ok_or_else(|| self.error("no mark", "a mark on the stack"))?;
        Ok(self.stack.drain(height..).collect())
    }

    fn pop_pairs(&mut self) -> Result<Vec<(Id, Id)>, PickleError> {
        let items = self.pop_to_mark()?;
        let (pairs, rest) = items.as_chunks::<2>();
        if !rest.is_empty() {
            return Err(self.error("a key without a value", "pairs"));
        }
        Ok(pairs.iter().map(|&[key, value]| (key, value)).collect())
    }

    fn top_id(&self) -> Result<Id, PickleError> {
        match self.stack.last() {
            Some(&id) if self.stack.len() > self.floor() => Ok(id),
            _ => Err(self.error("an empty stack", "a value on it")),
        }
    }

    fn top(&mut self) -> Result<&mut Value<'a>, PickleError> {
        let id = self.top_id()?;
        Ok(&mut self.values[id as usize])
    }

    fn add_items(&mut self, items: &[Id]) -> Result<bool, PickleError> {
        match self.top()? {
            Value::List(list) | Value::Set(list) => list.extend_from_slice(items),
            // The contents of list-like objects are not used.
            Value::Object(_) => {}
            _ => return Err(self.error("items appended to a value of another type", "a list")),
        }
        Ok(true)
    }

    fn add_entries(&mut self, pairs: &[(Id, Id)]) -> Result<bool, PickleError> {
        match self.top()? {
            Value::Dict(entries) => entries.extend_from_slice(pairs),
            Value::Object(object) => object.entries.extend_from_slice(pairs),
            _ => return Err(self.error("entries set on a value of another type", "a dict")),
        }
        Ok(true)
    }

    fn recall(&mut self, slot: u32) -> Result<(), PickleError> {
        let id = self.memo.get(&slot).copied();
        let id = id.ok_or_else(|| self.error(format!("empty memo slot {slot}"), "a filled slot"))?;
        self.push(id)
    }

    fn memoize(&mut self, slot: u32) -> Result<(), PickleError> {
        let id = self.top_id()?;
        if self.memo.len() >= MAX_VALUES && !self.memo.contains_key(&slot) {
            return Err(self.error("more memo entries than any checkpoint has", "fewer"));
        }
        self.memo.insert(slot, id);
        Ok(())
    }
}
