//! Structs and constants that the host and shaders share: declared in Rust, from which their declarations in WGSL follow.

use std::fmt;

use glam::{UVec2, UVec3, Vec2, Vec3, Vec4};

/// A type that shaders have as well.
pub trait Shared {
    /// Its name in WGSL.
    fn name() -> String;
}

macro_rules! name_types {
    ($($type:ty = $name:literal),* $(,)?) => {$(
        impl Shared for $type {
            fn name() -> String {
                $name.to_owned()
            }
        }
    )*};
}

name_types! {
    u32 = "u32",
    f32 = "f32",
    UVec2 = "vec2<u32>",
    UVec3 = "vec3<u32>",
    Vec2 = "vec2<f32>",
    Vec3 = "vec3<f32>",
    Vec4 = "vec4<f32>",
}

impl<T: Shared, const N: usize> Shared for [T; N] {
    fn name() -> String {
        format!("array<{}, {N}>", T::name())
    }
}

/// A member of a struct.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Member {
    pub name: &'static str,
    /// Its type in WGSL.
    pub type_name: String,
    /// Bytes from the struct's beginning.
    pub offset: usize,
}

/// What a struct is in WGSL.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Declaration {
    pub name: &'static str,
    pub members: Vec<Member>,
    /// Bytes of all of it.
    pub bytes: usize,
}

impl fmt::Display for Declaration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "struct {} {{", self.name)?;
        for Member { name, type_name, .. } in &self.members {
            writeln!(f, "    {name}: {type_name},")?;
        }
        writeln!(f, "}}")
    }
}

/// A table of structs, in rows of 16 bytes.
pub struct Table {
    /// The struct of its entries.
    pub entry: &'static str,
    /// What the function is called that reads an entry.
    pub reader: &'static str,
    /// Member of `frame.tables` that has its first row.
    pub first_row: &'static str,
}

/// Bytes of a row of tables.
pub const ROW_BYTES: usize = 16;

impl Declaration {
    /// The function that reads an entry of a table of these.
    ///
    /// # Panics
    /// If a member crosses rows, or is of a type that tables do not have.
    pub fn reader(&self, table: &Table) -> String {
        assert!(self.bytes.is_multiple_of(ROW_BYTES), "{} fills no rows", self.name);
        let rows = self.bytes / ROW_BYTES;
        let Self { name, .. } = self;
        let Table { reader, first_row, .. } = table;
        let mut out = format!("fn {reader}(index: u32) -> {name} {{\n");
        out += &format!("    let at = frame.tables.{first_row} + {rows}u * index;\n");
        for row in 0..rows {
            out += &format!("    let row{row} = table_row(at + {row}u);\n");
        }
        let members: Vec<String> = self.members.iter().map(|member| member.in_rows()).collect();
        out + &format!("    return {name}({});\n}}\n", members.join(", "))
    }
}

impl Member {
    /// What it is of the rows `row0` and so on.
    fn in_rows(&self) -> String {
        let (first, row) = (self.offset % ROW_BYTES / 4, self.offset / ROW_BYTES);
        let words = match self.type_name.as_str() {
            "u32" | "f32" => 1,
            "vec2<u32>" | "vec2<f32>" => 2,
            "vec3<f32>" => 3,
            "vec4<f32>" => 4,
            other => panic!("{other} in a table"),
        };
        let bits = format!("row{row}.{}", &"xyzw"[first..first + words]);
        if self.type_name.contains("f32") { format!("bitcast<{}>({bits})", self.type_name) } else { bits }
    }
}

/// Declares structs of plain data that shaders have as well, under the same names, and `structs`, which lists them.
macro_rules! shared_structs {
    ($($(#[$about:meta])* pub struct $name:ident { $($(#[$what:meta])* pub $member:ident: $type:ty,)* })*) => {
        $(
            $(#[$about])*
            #[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
            #[repr(C)]
            pub struct $name {
                $($(#[$what])* pub $member: $type,)*
            }

            impl $crate::wgsl::Shared for $name {
                fn name() -> String {
                    stringify!($name).to_owned()
                }
            }
        )*

        /// What the structs of this module are in shaders.
        pub fn structs() -> Vec<$crate::wgsl::Declaration> {
            vec![$($crate::wgsl::Declaration {
                name: stringify!($name),
                members: vec![$($crate::wgsl::Member {
                    name: stringify!($member),
                    type_name: <$type as $crate::wgsl::Shared>::name(),
                    offset: std::mem::offset_of!($name, $member),
                }),*],
                bytes: size_of::<$name>(),
            }),*]
        }
    };
}

/// A constant of shaders: its name and its value.
pub type Constant = (&'static str, u32);

/// Constants under the names that they have in Rust.
macro_rules! constants {
    ($($name:ident),* $(,)?) => { &[$((stringify!($name), $name)),*] };
}

/// Declares constants, and `CONSTANTS`, which is all of them for shaders.
macro_rules! shared_constants {
    ($($(#[$about:meta])* $visible:vis const $name:ident: u32 = $value:expr;)*) => {
        $($(#[$about])* $visible const $name: u32 = $value;)*

        /// Those above, for shaders.
        pub(crate) const CONSTANTS: &[$crate::wgsl::Constant] = $crate::wgsl::constants![$($name),*];
    };
}

pub(crate) use {constants, shared_constants, shared_structs};

/// The declarations of constants.
pub fn declare(constants: &[Constant]) -> String {
    constants.iter().map(|(name, value)| format!("const {name}: u32 = {value}u;\n")).collect()
}
