//! Structs and constants shared by host and shaders. They are declared in Rust, and the WGSL declarations are
//! generated.

use std::fmt;

use glam::{UVec2, UVec3, UVec4, Vec2, Vec3, Vec4};

/// A type that exists in Rust and in WGSL.
pub trait Shared {
    /// Returns its name in WGSL.
    fn name() -> String;
}

/// The content of a texel of a resource.
pub trait Texel {
    /// WGSL type of the elements of the resource's array. A texel consists of one or more elements.
    const ELEMENT: &'static str;
}

macro_rules! name_types {
    ($($type:ty = $name:literal),* $(,)?) => {$(
        impl Shared for $type {
            fn name() -> String {
                $name.to_owned()
            }
        }

        impl Texel for $type {
            const ELEMENT: &'static str = $name;
        }
    )*};
}

name_types! {
    u32 = "u32",
    f32 = "f32",
    UVec2 = "vec2<u32>",
    UVec3 = "vec3<u32>",
    UVec4 = "vec4<u32>",
    Vec2 = "vec2<f32>",
    Vec3 = "vec3<f32>",
    Vec4 = "vec4<f32>",
}

impl<T: Shared, const N: usize> Shared for [T; N] {
    fn name() -> String {
        format!("array<{}, {N}>", T::name())
    }
}

impl<T: Texel, const N: usize> Texel for [T; N] {
    const ELEMENT: &'static str = T::ELEMENT;
}

/// A member of a struct.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Member {
    pub name: &'static str,
    /// Its type in WGSL.
    pub type_name: String,
    /// Offset from the start of the struct, bytes.
    pub offset: usize,
}

/// Declaration of a struct in WGSL.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Declaration {
    pub name: &'static str,
    pub members: Vec<Member>,
    /// Size of the struct, bytes.
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
    /// Name of the function that reads an entry.
    pub reader: &'static str,
    /// Member of `frame.tables` that holds the index of its first row.
    pub first_row: &'static str,
}

/// Size of a table row, bytes.
pub const ROW_BYTES: usize = 16;

impl Declaration {
    /// Returns the WGSL function that reads an entry of a table of this struct.
    ///
    /// # Panics
    /// If the struct does not fill whole rows, or if a member crosses rows or has a type that tables do not support.
    pub fn reader(&self, table: &Table) -> String {
        assert!(self.bytes.is_multiple_of(ROW_BYTES), "{} does not fill whole rows", self.name);
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
    /// Returns the WGSL expression of this member in terms of `row0` and the rows after it.
    fn in_rows(&self) -> String {
        let (first, row) = (self.offset % ROW_BYTES / 4, self.offset / ROW_BYTES);
        let words = match self.type_name.as_str() {
            "u32" | "f32" => 1,
            "vec2<u32>" | "vec2<f32>" => 2,
            "vec3<f32>" => 3,
            "vec4<f32>" => 4,
            other => panic!("tables do not support members of type {other}"),
        };
        let bits = format!("row{row}.{}", &"xyzw"[first..first + words]);
        if self.type_name.contains("f32") { format!("bitcast<{}>({bits})", self.type_name) } else { bits }
    }
}

/// Declares plain-data structs that shaders share under the same names, and a function `structs` that lists them.
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

            impl $crate::wgsl::Texel for $name {
                const ELEMENT: &'static str = stringify!($name);
            }
        )*

        /// Returns the WGSL declarations of this module's structs.
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

/// Arguments of a kernel: up to three numbers of 32 bits, with names that its shader uses.
pub trait Arguments: bytemuck::Pod {
    /// Names and WGSL types, in order.
    const MEMBERS: &'static [(&'static str, &'static str)];

    /// Returns the arguments as words; those that the kernel does not have are 0.
    fn words(self) -> Words {
        let mut words = Words::default();
        bytemuck::bytes_of_mut(&mut words)[..size_of::<Self>()].copy_from_slice(bytemuck::bytes_of(&self));
        words
    }
}

/// Arguments of any kernel. In WGSL, they are the struct `Arguments` of the kernel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(transparent)]
pub struct Words(pub [u32; 3]);

impl Shared for Words {
    fn name() -> String {
        "Arguments".to_owned()
    }
}

/// Returns the WGSL declaration of a kernel's arguments. If they have no names, they are an array.
pub fn declare_arguments(members: &[(&str, &str)]) -> String {
    let lines = members.iter().map(|(name, of)| format!("    {name}: {of},\n"));
    // Every kernel's arguments fill three words.
    let pads = (members.len()..3).map(|i| format!("    pad{i}: u32,\n"));
    match members {
        [] => "alias Arguments = array<u32, 3>;\n".to_owned(),
        _ => format!("struct Arguments {{\n{}}}\n", lines.chain(pads).collect::<String>()),
    }
}

/// Declares the arguments of a kernel.
macro_rules! arguments {
    ($(#[$about:meta])* $visible:vis struct $name:ident { $($(#[$what:meta])* pub $member:ident: $type:ident,)* }) => {
        $(#[$about])*
        #[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
        #[repr(C)]
        $visible struct $name {
            $($(#[$what])* pub $member: $type,)*
        }

        impl $crate::wgsl::Arguments for $name {
            const MEMBERS: &'static [(&'static str, &'static str)] =
                &[$((stringify!($member), stringify!($type))),*];
        }
    };
}

/// Name and value of a shader constant.
pub type Constant = (&'static str, u32);

/// Lists Rust constants as shader constants of the same names.
macro_rules! constants {
    ($($name:ident),* $(,)?) => { &[$((stringify!($name), $name)),*] };
}

/// Declares constants, and `CONSTANTS`, which lists all of them for shaders.
macro_rules! shared_constants {
    ($($(#[$about:meta])* $visible:vis const $name:ident: u32 = $value:expr;)*) => {
        $($(#[$about])* $visible const $name: u32 = $value;)*

        /// Constants declared above, for shaders.
        pub(crate) const CONSTANTS: &[$crate::wgsl::Constant] = $crate::wgsl::constants![$($name),*];
    };
}

pub(crate) use {arguments, constants, shared_constants, shared_structs};

/// Returns the WGSL declarations of constants.
pub fn declare(constants: &[Constant]) -> String {
    constants.iter().map(|(name, value)| format!("const {name}: u32 = {value}u;\n")).collect()
}
