//! Conversion of messages of ROS 1 to those of ROS 2 in CDR.
//!
//! The bag carries the definition of each type, so messages of other versions than today's are converted, too. Fields are
//! matched by name, without regard to case (`K` of ROS 1 is `k` of ROS 2). Fields that ROS 2 lacks, such as `seq` of a
//! header, are left out. Fields that only ROS 2 has are empty or 0.

use super::definitions::{Definitions, Field, Kind, Length, Primitive};
use splatseg_ros::{Interface, Message, NavPath, Transform};

/// Encapsulation of CDR, little endian.
const CDR: [u8; 4] = [0, 1, 0, 0];
/// Maximum number of fields, counted each time that their type is used, and of types in each other.
const MAX_PARTS: usize = 4096;
const MAX_DEPTH: usize = 16;
/// A converted message is at most this many times as long, and this many bytes longer: padding and empty fields.
const MAX_RATIO: usize = 4;
const MAX_MORE_BYTES: usize = 4096;
const CUT_OFF: &str = "the message is cut off, or not of its type";

/// Converts the messages of a connection.
#[derive(Debug)]
pub(super) struct Transcoder {
    type_name: &'static str,
    source: Vec<Part>,
    target: Vec<TargetField>,
}

/// A field of a message of ROS 1.
#[derive(Debug)]
struct Part {
    kind: PartKind,
    length: Length,
    /// Bytes of an element, if all have as many.
    fixed: Option<u64>,
    /// Least bytes of an element.
    least: u64,
}

#[derive(Debug)]
enum PartKind {
    Fixed,
    Text,
    Message(Vec<Part>),
}

/// A field of a message of ROS 2.
#[derive(Debug)]
struct TargetField {
    /// Index of the field of ROS 1; `None` if there is none.
    source: Option<usize>,
    kind: TargetKind,
    length: Length,
}

#[derive(Debug)]
enum TargetKind {
    Primitive(Primitive),
    Text,
    Time,
    Message(Vec<TargetField>),
}

/// Returns the type of ROS 2 to which one of ROS 1 is converted; `None` if it is not used here.
fn interface(type_name: &str) -> Option<Interface> {
    let name = match type_name {
        "tf/tfMessage" => "tf2_msgs/msg/TFMessage".to_owned(),
        name => name.replacen('/', "/msg/", 1),
    };
    let others = [NavPath::INTERFACE, Transform::INTERFACE];
    Interface::of_camera(&name).or_else(|| others.into_iter().find(|interface| interface.name == name))
}

impl Transcoder {
    /// Prepares the conversion of messages of the type `type_name`, e.g. `sensor_msgs/Image`. Returns `None` if messages
    /// of that type are not used.
    ///
    /// # Errors
    /// Description of what is wrong with the definition.
    pub(super) fn new(type_name: &str, definition: &str) -> Option<Result<Self, String>> {
        interface(type_name).map(|interface| Self::to_interface(interface, type_name, definition))
    }

    fn to_interface(interface: Interface, type_name: &str, definition: &str) -> Result<Self, String> {
        let source = Definitions::parse(type_name, definition)?;
        let target_name = interface.name.replace("/msg/", "/");
        let target = Definitions::parse(&target_name, &interface.schema())?;
        if source.fields(type_name)?.is_empty() {
            return Err("its definition is missing".to_owned());
        }
        let mut budget = MAX_PARTS;
        Ok(Self {
            type_name: interface.name,
            source: parts(&source, type_name, 0, &mut budget)?,
            target: Pairing { source: &source, target: &target }.fields(Some(type_name), &target_name, 0)?,
        })
    }

    /// Returns the type of ROS 2, e.g. `sensor_msgs/msg/Image`.
    pub(super) fn type_name(&self) -> &'static str {
        self.type_name
    }

    /// Converts a message.
    ///
    /// # Errors
    /// Description of the damage.
    pub(super) fn transcode(&self, data: &[u8]) -> Result<Vec<u8>, String> {
        let mut bytes = Vec::with_capacity(data.len() + CDR.len() + 64);
        bytes.extend(CDR);
        let limit = data.len().saturating_mul(MAX_RATIO).saturating_add(MAX_MORE_BYTES);
        let mut writer = CdrWriter { bytes, limit };
        match writer.message(&self.target, &self.source, data) {
            // Some recorders leave more bytes after a message.
            Some(()) => Ok(writer.bytes),
            None => Err(CUT_OFF.to_owned()),
        }
    }
}

/// Returns the fields of a type of ROS 1 with their sizes.
fn parts(definitions: &Definitions, name: &str, depth: usize, budget: &mut usize) -> Result<Vec<Part>, String> {
    if depth > MAX_DEPTH {
        return Err("its definition contains itself".to_owned());
    }
    let part = |field: &Field| {
        *budget = budget.checked_sub(1).ok_or("its definition has too many fields")?;
        let (kind, fixed, least) = match &field.kind {
            Kind::Primitive(primitive) => (PartKind::Fixed, Some(primitive.bytes() as u64), 1),
            Kind::Time => (PartKind::Fixed, Some(8), 8),
            Kind::Text => (PartKind::Text, None, 4),
            Kind::Message(name) => {
                let parts = parts(definitions, name, depth + 1, budget)?;
                let fixed = parts.iter().map(Part::fixed).try_fold(0u64, |sum, bytes| Some(sum.saturating_add(bytes?)));
                let least = parts.iter().map(Part::least).fold(0, u64::saturating_add);
                (PartKind::Message(parts), fixed, least)
            }
        };
        // An array of nothing could have billions of elements.
        if least == 0 && field.length != Length::One {
            return Err(format!("its field {} is an array of an empty type", field.name));
        }
        Ok(Part { kind, length: field.length, fixed, least })
    };
    definitions.fields(name)?.iter().map(part).collect()
}

impl Part {
    /// Returns the bytes of the whole field, if there are always as many.
    fn fixed(&self) -> Option<u64> {
        match self.length {
            Length::One => self.fixed,
            Length::Fixed(count) => Some(self.fixed?.saturating_mul(count)),
            Length::Stated => None,
        }
    }

    fn least(&self) -> u64 {
        match self.length {
            Length::One => self.least,
            Length::Fixed(count) => self.least.saturating_mul(count),
            Length::Stated => 4,
        }
    }

    /// Splits the number of elements off the bytes that begin with the field; `None` if they cannot all be there.
    fn count<'d>(&self, data: &'d [u8]) -> Option<(u64, &'d [u8])> {
        let (count, rest) = match self.length {
            Length::One => (1, data),
            Length::Fixed(count) => (count, data),
            Length::Stated => {
                let (count, rest) = data.split_first_chunk()?;
                (u64::from(u32::from_le_bytes(*count)), rest)
            }
        };
        (count.checked_mul(self.least)? <= rest.len() as u64).then_some((count, rest))
    }

    /// Returns the number of bytes of an element, at the start of `data`.
    fn element_bytes(&self, data: &[u8]) -> Option<usize> {
        let bytes = match (&self.kind, self.fixed) {
            (_, Some(fixed)) => usize::try_from(fixed).ok()?,
            (PartKind::Text, None) => {
                let length: &[u8; 4] = data.first_chunk()?;
                usize::try_from(u32::from_le_bytes(*length)).ok()?.checked_add(4)?
            }
            (PartKind::Message(parts), None) => {
                parts.iter().try_fold(0, |sum, part| Some(sum + part.bytes(data.get(sum..)?)?))?
            }
            (PartKind::Fixed, None) => return None,
        };
        (bytes <= data.len()).then_some(bytes)
    }

    /// Returns the number of bytes of the field, at the start of `data`.
    fn bytes(&self, data: &[u8]) -> Option<usize> {
        let (count, elements) = self.count(data)?;
        let before = data.len() - elements.len();
        let bytes = match self.fixed {
            Some(fixed) => usize::try_from(fixed.checked_mul(count)?).ok()?,
            None => {
                let mut position = 0;
                for _ in 0..count {
                    position += self.element_bytes(elements.get(position..)?)?;
                }
                position
            }
        };
        (bytes <= elements.len()).then_some(before + bytes)
    }
}

/// Matches the fields of two types.
struct Pairing<'a> {
    source: &'a Definitions,
    target: &'a Definitions,
}

impl Pairing<'_> {
    /// Returns the fields of the type `target` of ROS 2, with their places in the type `source` of ROS 1, if there is one.
    fn fields(&self, source: Option<&str>, target: &str, depth: usize) -> Result<Vec<TargetField>, String> {
        if depth > MAX_DEPTH {
            return Err("its definition contains itself".to_owned());
        }
        let sources = source.map_or(Ok(&[][..]), |source| self.source.fields(source))?;
        let mut fields = Vec::new();
        for field in self.target.fields(target)? {
            let found = sources.iter().position(|source| source.name.eq_ignore_ascii_case(&field.name));
            let of_source = found.and_then(|index| sources.get(index));
            let differs = || format!("its field {} is of another type than in ROS 2", field.name);
            if of_source.is_some_and(|source| source.length != field.length) {
                return Err(differs());
            }
            let kind = match (&field.kind, of_source.map(|source| &source.kind)) {
                (Kind::Primitive(wanted), None) => TargetKind::Primitive(*wanted),
                (Kind::Primitive(wanted), Some(Kind::Primitive(found))) if wanted == found => {
                    TargetKind::Primitive(*wanted)
                }
                (Kind::Text, None | Some(Kind::Text)) => TargetKind::Text,
                (Kind::Message(name), None | Some(Kind::Time)) if is_time(name) => TargetKind::Time,
                (Kind::Message(wanted), Some(Kind::Message(found))) => {
                    TargetKind::Message(self.fields(Some(found), wanted, depth + 1)?)
                }
                (Kind::Message(wanted), None) => TargetKind::Message(self.fields(None, wanted, depth + 1)?),
                _ => return Err(differs()),
            };
            fields.push(TargetField { source: found, kind, length: field.length });
        }
        Ok(fields)
    }
}

fn is_time(name: &str) -> bool {
    matches!(name, "builtin_interfaces/Time" | "builtin_interfaces/Duration")
}

/// Writes a message in CDR. All functions return `None` if the message of ROS 1 is damaged.
struct CdrWriter {
    bytes: Vec<u8>,
    limit: usize,
}

impl CdrWriter {
    /// Pads to a multiple of `bytes` after the encapsulation.
    fn align(&mut self, bytes: usize) {
        let length = (self.bytes.len() - CDR.len()).next_multiple_of(bytes.max(1)) + CDR.len();
        self.bytes.resize(length, 0);
    }

    /// Writes a number of elements.
    fn count(&mut self, count: usize) -> Option<()> {
        self.align(4);
        self.bytes.extend(u32::try_from(count).ok()?.to_le_bytes());
        Some(())
    }

    /// Writes the fields of a message, which is at the start of `data`.
    fn message(&mut self, fields: &[TargetField], parts: &[Part], data: &[u8]) -> Option<()> {
        let mut places = Vec::with_capacity(parts.len());
        let mut rest = data;
        for part in parts {
            let (field, after) = rest.split_at_checked(part.bytes(rest)?)?;
            places.push((part, field));
            rest = after;
        }
        for field in fields {
            match field.source {
                Some(index) => {
                    let (part, data) = places.get(index)?;
                    self.field(field, part, data)?;
                }
                None => self.empty(field)?,
            }
        }
        (self.bytes.len() <= self.limit).then_some(())
    }

    /// Writes a field, whose bytes in ROS 1 are `data`.
    fn field(&mut self, field: &TargetField, part: &Part, data: &[u8]) -> Option<()> {
        let (count, mut elements) = part.count(data)?;
        if field.length == Length::Stated {
            self.count(usize::try_from(count).ok()?)?;
        }
        match (&field.kind, &part.kind) {
            // What is aligned is the first element, if there is one.
            (TargetKind::Primitive(_) | TargetKind::Time, _) if count == 0 => {}
            (TargetKind::Primitive(primitive), _) => {
                self.align(primitive.bytes());
                self.bytes.extend_from_slice(elements);
            }
            (TargetKind::Time, _) => {
                self.align(4);
                self.bytes.extend_from_slice(elements);
            }
            (TargetKind::Text, _) => {
                for _ in 0..count {
                    let (text, rest) = elements.split_at_checked(part.element_bytes(elements)?)?;
                    self.text(text.get(4..)?)?;
                    elements = rest;
                }
            }
            (TargetKind::Message(fields), PartKind::Message(parts)) => {
                for _ in 0..count {
                    let (element, rest) = elements.split_at_checked(part.element_bytes(elements)?)?;
                    self.message(fields, parts, element)?;
                    elements = rest;
                }
            }
            (TargetKind::Message(_), _) => return None,
        }
        Some(())
    }

    /// Writes a text and the zero after it.
    fn text(&mut self, text: &[u8]) -> Option<()> {
        self.count(text.len() + 1)?;
        self.bytes.extend_from_slice(text);
        self.bytes.push(0);
        Some(())
    }

    /// Writes a field that ROS 1 lacks.
    fn empty(&mut self, field: &TargetField) -> Option<()> {
        let count = match field.length {
            Length::One => 1,
            Length::Fixed(count) => count,
            Length::Stated => return self.count(0),
        };
        for _ in 0..count {
            match &field.kind {
                TargetKind::Primitive(primitive) => {
                    self.align(primitive.bytes());
                    self.bytes.resize(self.bytes.len() + primitive.bytes(), 0);
                }
                TargetKind::Time => {
                    self.align(4);
                    self.bytes.extend([0; 8]);
                }
                TargetKind::Text => self.text(b"")?,
                TargetKind::Message(fields) => fields.iter().try_for_each(|field| self.empty(field).ok_or(())).ok()?,
            }
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use splatseg_ros::{CameraInfo, Image, PoseStamped, TfMessage, from_cdr};

    const HEADER: &str = "\n====\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n";

    fn text(text: &str) -> Vec<u8> {
        [&(text.len() as u32).to_le_bytes(), text.as_bytes()].concat()
    }

    /// A header with `seq` 9, at 5.000000007 s.
    fn header(frame: &str) -> Vec<u8> {
        [&[9, 0, 0, 0, 5, 0, 0, 0, 7, 0, 0, 0][..], &text(frame)].concat()
    }

    fn floats(numbers: impl IntoIterator<Item = f64>) -> Vec<u8> {
        numbers.into_iter().flat_map(f64::to_le_bytes).collect()
    }

    fn transcoder(type_name: &str, definition: &str) -> Result<Transcoder, String> {
        Transcoder::new(type_name, definition).unwrap()
    }

    #[test]
    fn an_image_is_converted_and_each_end_noticed() {
        let definition = format!(
            "Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\nuint8[] data{HEADER}"
        );
        let image = transcoder("sensor_msgs/Image", &definition).unwrap();
        assert_eq!(image.type_name(), "sensor_msgs/msg/Image");
        let bytes = [
            header("cam"),
            vec![1, 0, 0, 0, 2, 0, 0, 0],
            text("rgb8"),
            vec![1, 6, 0, 0, 0, 6, 0, 0, 0, 1, 2, 3, 4, 5, 6],
        ]
        .concat();
        let cdr = image.transcode(&[&bytes[..], &[0; 4]].concat()).unwrap();
        let read: Image<'_> = from_cdr(&cdr).unwrap();
        assert_eq!((read.header.stamp.sec, read.header.stamp.nanosec), (5, 7));
        assert_eq!((read.header.frame_id.as_str(), read.height, read.width, read.encoding), ("cam", 1, 2, "rgb8"));
        assert_eq!((read.is_bigendian, read.step, read.data), (1, 6, &[1, 2, 3, 4, 5, 6][..]));
        for end in 0..bytes.len() {
            assert_eq!(image.transcode(&bytes[..end]).unwrap_err(), CUT_OFF, "{end}");
        }
    }

    #[test]
    fn fields_are_matched_by_name_and_others_empty() {
        // In another order than in ROS 2, with a field that it lacks, and without most others.
        let definition = format!("float64[9] K\nstring owner\nfloat64[] D\nuint32 width\nHeader header{HEADER}");
        let info = transcoder("sensor_msgs/CameraInfo", &definition).unwrap();
        let bytes = [
            floats((0..9).map(f64::from)),
            text("me"),
            vec![2, 0, 0, 0],
            floats([0.5, 0.25]),
            vec![64, 0, 0, 0],
            header("c"),
        ];
        let read: CameraInfo = from_cdr(&info.transcode(&bytes.concat()).unwrap()).unwrap();
        let expected = CameraInfo {
            header: read.header.clone(),
            width: 64,
            d: vec![0.5, 0.25],
            k: [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0],
            r: [0.0; 9],
            p: [0.0; 12],
            ..CameraInfo::default()
        };
        assert_eq!(read, expected);
        assert_eq!(read.header.frame_id, "c");
    }

    #[test]
    fn arrays_of_messages_are_converted() {
        let definition = format!(
            "geometry_msgs/TransformStamped[] transforms\n====\nMSG: geometry_msgs/TransformStamped\nHeader header\n\
             string child_frame_id\nTransform transform\n====\nMSG: geometry_msgs/Transform\nVector3 translation\n\
             Quaternion rotation\n====\nMSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n====\nMSG: \
             geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w{HEADER}"
        );
        let tf = transcoder("tf/tfMessage", &definition).unwrap();
        assert_eq!(tf.type_name(), "tf2_msgs/msg/TFMessage");
        let one = |parent: &str, child: &str, x: f64| {
            [header(parent), text(child), floats([x, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0])].concat()
        };
        let bytes = [vec![2, 0, 0, 0], one("map", "odom", 1.5), one("odometry", "b", -1.0)].concat();
        let read: TfMessage = from_cdr(&tf.transcode(&bytes).unwrap()).unwrap();
        let shifts: Vec<_> = read
            .transforms
            .iter()
            .map(|one| (one.header.frame_id.as_str(), one.child_frame_id.as_str(), one.transform.translation.x))
            .collect();
        assert_eq!(shifts, [("map", "odom", 1.5), ("odometry", "b", -1.0)]);
        let none: TfMessage = from_cdr(&tf.transcode(&[0; 4]).unwrap()).unwrap();
        assert!(none.transforms.is_empty());
        assert_eq!(tf.transcode(&[255; 200]).unwrap_err(), CUT_OFF, "four billion transforms");
    }

    #[test]
    fn impossible_definitions_are_described() {
        let error = |definition: &str| transcoder("geometry_msgs/PoseStamped", definition).unwrap_err();
        assert_eq!(error(""), "its definition is missing");
        assert_eq!(error("Header header"), "the type \"std_msgs/Header\" is not defined");
        assert_eq!(error("Pose pose\nPoseStamped self"), "the type \"geometry_msgs/Pose\" is not defined");
        assert_eq!(error("PoseStamped self"), "its definition contains itself");
        assert_eq!(error("float64 header"), "its field header is of another type than in ROS 2");
        assert_eq!(error(&format!("Header[2] header{HEADER}")), "its field header is of another type than in ROS 2");
        let empty = "a/Empty[] none\n====\nMSG: a/Empty\n";
        assert_eq!(error(empty), "its field none is an array of an empty type");
        let wide: String =
            (0..12).map(|level| format!("====\nMSG: a/L{level}\nL{0} one\nL{0} two\n", level + 1)).collect();
        assert_eq!(error(&format!("a/L0 top\n{wide}====\nMSG: a/L12\nint8 x\n")), "its definition has too many fields");
        assert!(Transcoder::new("sensor_msgs/Imu", "").is_none());
    }

    #[test]
    fn a_message_does_not_grow_beyond_measure() {
        // A path of poses of one byte each, which would all be filled with zeros.
        let definition = "geometry_msgs/PoseStamped[] poses\n====\nMSG: geometry_msgs/PoseStamped\nint8 nothing\n";
        let path = transcoder("nav_msgs/Path", definition).unwrap();
        let bytes = |count: u32| [&count.to_le_bytes()[..], &vec![0; count as usize]].concat();
        assert!(path.transcode(&bytes(20)).is_ok());
        assert_eq!(path.transcode(&bytes(100_000)).unwrap_err(), CUT_OFF);
        let pose = Transcoder::new("geometry_msgs/PoseStamped", "int8 nothing").unwrap().unwrap();
        assert!(from_cdr::<PoseStamped>(&pose.transcode(&[0]).unwrap()).is_ok());
    }
}
