//! What a recording says of the types of its messages.

/// The definition of a message type.
#[derive(Clone, Copy, Debug)]
pub struct Interface {
    /// Its name, e.g. `sensor_msgs/msg/Image`.
    pub name: &'static str,
    /// Its constants and fields, one a line.
    pub fields: &'static str,
    /// The types that its fields have, other than built-in ones.
    pub uses: &'static [&'static Interface],
}

/// A message.
pub trait Message {
    /// The definition of its type.
    const INTERFACE: Interface;
}

impl Interface {
    /// The definition with those of all types in it, as recordings carry it (`ros2msg`).
    pub fn schema(&self) -> String {
        let mut schema = self.fields.to_owned();
        let mut listed: Vec<&Interface> = self.uses.to_vec();
        let mut next = 0;
        while let Some(interface) = listed.get(next).copied() {
            next += 1;
            schema += &format!("{}\nMSG: {}\n{}", "=".repeat(80), interface.short_name(), interface.fields);
            for inner in interface.uses {
                if listed.iter().all(|known| known.name != inner.name) {
                    listed.push(inner);
                }
            }
        }
        schema
    }

    /// Its name as fields write it, e.g. `sensor_msgs/Image`.
    fn short_name(&self) -> String {
        self.name.replace("/msg/", "/")
    }
}

#[cfg(test)]
mod tests {
    use crate::{MarkerArray, Message, Odometry};

    #[test]
    fn a_schema_defines_every_type_once() {
        for schema in [Odometry::INTERFACE.schema(), MarkerArray::INTERFACE.schema()] {
            let defined: Vec<&str> = schema.lines().filter_map(|line| line.strip_prefix("MSG: ")).collect();
            for line in schema.lines().filter(|line| line.contains('/') && !line.starts_with("MSG: ")) {
                let used = line.split([' ', '[']).next().unwrap();
                assert_eq!(defined.iter().filter(|name| **name == used).count(), 1, "{used} in\n{schema}");
            }
        }
    }
}
