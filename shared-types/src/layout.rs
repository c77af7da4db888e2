//! Declares a message: a `repr(C)` struct with a name, a schema version and a hash of its layout.
//!
//! Shared memory compares types by name and size only; two builds with reordered fields of equal size would read each
//! other's velocities as positions. The hash goes into the channel's attributes, so that such a pair refuses to talk.

/// FNV-1a over the fields' names, types and offsets.
pub(crate) const fn layout_hash(fields: &[(&str, &str, usize)], size: usize) -> u64 {
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    let mut index = 0;
    while index < fields.len() {
        let (name, ty, offset) = fields[index];
        hash = fold(hash, name.as_bytes());
        hash = fold(hash, ty.as_bytes());
        hash = (hash ^ offset as u64).wrapping_mul(0x0100_0000_01b3);
        index += 1;
    }
    (hash ^ size as u64).wrapping_mul(0x0100_0000_01b3)
}

const fn fold(mut hash: u64, bytes: &[u8]) -> u64 {
    let mut index = 0;
    while index < bytes.len() {
        hash = (hash ^ bytes[index] as u64).wrapping_mul(0x0100_0000_01b3);
        index += 1;
    }
    hash
}

/// Declares a message type and implements [`crate::Message`] for it; the first field must be `header: Header`.
macro_rules! message {
    (
        $(#[$meta:meta])*
        $name:ident, $type_name:literal, schema $schema:literal {
            $( $(#[$field_meta:meta])* $field:ident : $ty:ty, )*
        }
    ) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq)]
        #[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
        #[cfg_attr(feature = "ipc", type_name($type_name))]
        #[repr(C)]
        pub struct $name {
            $( $(#[$field_meta])* pub $field: $ty, )*
        }

        impl $crate::header::Message for $name {
            const TYPE_NAME: &'static str = $type_name;
            const SCHEMA: u16 = $schema;
            const LAYOUT: u64 = $crate::layout::layout_hash(
                &[ $( (stringify!($field), stringify!($ty), core::mem::offset_of!($name, $field)), )* ],
                size_of::<$name>(),
            );
            fn header(&self) -> &$crate::header::Header { &self.header }
            fn header_mut(&mut self) -> &mut $crate::header::Header { &mut self.header }
        }
    };
}
pub(crate) use message;
