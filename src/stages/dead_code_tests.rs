//! Removal of code that cannot run.

use std::collections::HashMap;

use naga::valid::{Capabilities, ValidationFlags, Validator};
use naga::{
    BinaryOperator, Block, Expression, Function, Handle, Literal, LocalVariable, Module, Statement, UnaryOperator,
};

use super::compile::{StageError, buffer_entry, build};
use super::dead_code::children;
use super::shader::pass_text;
use super::specialization::Specialization;
use super::*;
use crate::device::{self, SceneAccess, Selection, Traversal};
use crate::frame::RunConfig;
use crate::graph::{Kernel, Pass, Resource, Stage, Use};
use crate::image::Extent;
use crate::passes::{self, tonemap};
use crate::scene::builtin;
use crate::scene::needs::SceneNeeds;
use crate::scene::rig::Eye;

/// Returns the module that a device gets for these values of override constants.
fn specialized(text: &str, constants: &[(&str, f64)], features: wgpu::Features) -> Module {
    let shader = Specialization { label: "test", text, entry_point: "main", constants, zero_workgroup_memory: false };
    let module = shader.module(features).unwrap_or_else(|| panic!("the shader is faulty: {text}"));
    let mut validator = Validator::new(ValidationFlags::all(), Capabilities::all());
    validator.validate(&module).unwrap_or_else(|e| panic!("{:?} in what is left of {text}", e.into_inner()));
    module
}

/// Returns the statements of a block and of the blocks inside it.
fn statements(block: &Block) -> Vec<&Statement> {
    let inside = |statement| std::iter::once(statement).chain(children(statement).into_iter().flat_map(statements));
    block.iter().flat_map(inside).collect()
}

fn functions(module: &Module) -> impl Iterator<Item = &Function> {
    module.functions.iter().map(|(_, f)| f).chain(module.entry_points.iter().map(|entry| &entry.function))
}

/// Counts the statements of a module that `is` accepts.
fn count(module: &Module, is: fn(&Statement) -> bool) -> usize {
    functions(module).flat_map(|f| statements(&f.body)).filter(|statement| is(statement)).count()
}

fn branches(module: &Module) -> usize {
    count(module, |statement| matches!(statement, Statement::If { .. }))
}

/// Specialises a kernel with this body for `ON` true and `OFF` false. `x` and `y` are unknown, and `dear` is a function
/// that writes.
fn kernel(body: &str) -> Module {
    let text = format!(
        "override ON: bool;
        override OFF: bool;
        @group(0) @binding(0) var<storage, read_write> out: array<u32>;
        @group(0) @binding(1) var<storage, read_write> other: array<u32>;
        fn dear() -> u32 {{ other[0] = 1u; return 2u; }}
        fn flips(p: ptr<function, bool>) {{ *p = !*p; }}
        fn both() -> bool {{ return ON && !OFF; }}
        fn neither(x: bool) -> bool {{ if x {{ return OFF; }} return !ON; }}
        fn writes() -> bool {{ out[2] = 1u; return false; }}
        fn sums(n: u32) -> bool {{ var s = 0u; for (var i = 0u; i < n; i++) {{ s += i; }} return OFF && s > 3u; }}
        @compute @workgroup_size(1)
        fn main(@builtin(global_invocation_id) id: vec3<u32>) {{
            let x = id.x > 3u;
            let y = id.y > 3u;
            {body}
        }}"
    );
    specialized(&text, &[("ON", 1.0), ("OFF", 0.0)], wgpu::Features::empty())
}

#[test]
fn known_conditions_leave_no_branch() {
    for condition in [
        "OFF",
        "!ON",
        "OFF && x",
        "x && OFF",
        "x && y && OFF",
        "x && (y && OFF)",
        "!(ON || x)",
        "!(x || ON)",
        "!(x || (y || ON))",
        "(x && OFF) || (OFF && y)",
        "OFF & x",
        "x & OFF",
        "OFF != (x && OFF)",
        "ON == OFF",
        "!both()",
        "x && !both()",
        "sums(id.x)",
        "neither(x)",
        "select(OFF, x, OFF)",
        "select(ON, OFF, ON && both())",
    ] {
        let module = kernel(&format!("if {condition} {{ out[0] = dear(); }} else {{ out[1] = 1u; }}"));
        assert_eq!(branches(&module), 0, "{condition}");
        assert!(module.functions.is_empty(), "{condition}: {:?}", module.functions);
        assert_eq!(module.global_variables.len(), 1, "{condition}");
    }
}

#[test]
fn unknown_conditions_stay() {
    for (condition, left) in [
        ("x", 1),
        ("x || OFF", 2),
        ("x && ON", 2),
        ("ON && x", 1),
        ("OFF || x", 1),
        ("x && y", 2),
        ("x && neither(y)", 0),
        ("x || neither(y)", 2),
        ("writes()", 1),
        ("x != ON", 1),
        ("select(OFF, x, ON)", 1),
    ] {
        let module = kernel(&format!("if {condition} {{ out[0] = dear(); }}"));
        assert_eq!(branches(&module), left, "{condition}");
        assert_eq!(module.functions.iter().any(|(_, f)| f.name.as_deref() == Some("dear")), left > 0, "{condition}");
    }
}

#[test]
fn changed_variables_count_as_unknown() {
    for (code, left) in [
        ("var v = OFF; if x { v = OFF; } if v { out[0] = dear(); }", 0),
        ("var v: bool; if x { v = OFF; } if v { out[0] = dear(); }", 0),
        ("var v: bool; if OFF { v = x; } if v { out[0] = dear(); }", 0),
        ("let v = x && OFF; if v { out[0] = dear(); }", 0),
        ("var v = OFF; if x { v = ON; } if v { out[0] = dear(); }", 2),
        ("var v: bool; if x { v = ON; } if v { out[0] = dear(); }", 2),
        ("var v = OFF; flips(&v); if v { out[0] = dear(); }", 1),
        ("var v = ON; loop { if !v { break; } v = OFF; out[0] = dear(); }", 1),
        ("for (var i = 0u; i < 3u && !OFF; i++) { out[i] = dear(); }", 2),
    ] {
        let module = kernel(code);
        assert_eq!(branches(&module), left, "{code}");
        assert_eq!(module.global_variables.len(), if left > 0 { 2 } else { 0 }, "{code}");
    }
}

#[test]
fn selections_keep_the_chosen_arm() {
    let module = kernel("out[0] = select(out[1], out[2], ON);");
    let loads = |statement: &&Statement| matches!(statement, Statement::Emit(_));
    let main = &module.entry_points[0].function;
    assert!(statements(&main.body).iter().filter(|s| loads(s)).count() > 0);
    let of = main.expressions.iter().filter(|(_, e)| matches!(e, Expression::Load { .. })).count();
    assert_eq!(of, 1, "{:?}", main.expressions);
}

#[test]
fn code_after_a_jump_is_removed() {
    for code in [
        "if ON { out[0] = 1u; return; } out[1] = dear();",
        "if x { return; } else { return; } out[1] = dear();",
        "{ return; } out[1] = dear();",
        "loop { if ON { break; } out[1] = dear(); }",
        "while OFF { out[1] = dear(); }",
        "for (var i = 0u; i < 3u && OFF; i++) { out[i] = dear(); }",
        "for (var i = 0u; i < 3u; i++) { if ON { continue; } out[i] = dear(); }",
        "switch id.x { case 0u: { if ON { break; } out[1] = dear(); } default: { return; out[2] = dear(); } }",
    ] {
        let module = kernel(code);
        assert!(module.functions.is_empty(), "{code}");
        assert_eq!(count(&module, |s| matches!(s, Statement::Call { .. })), 0, "{code}");
    }
    let loops = |code| count(&kernel(code), |s| matches!(s, Statement::Loop { .. }));
    assert_eq!(["while OFF { }", "while ON { if x { break; } }"].map(loops), [0, 1]);
}

#[test]
fn workgroup_and_array_sizes_can_be_overrides() {
    let text = "override SIZE: u32 = 2u;
        override HAS_TILE: bool = true;
        override UNUSED: f32;
        var<workgroup> tile: array<u32, SIZE>;
        @group(0) @binding(0) var<storage, read_write> out: array<u32>;
        @compute @workgroup_size(4, SIZE * 4u)
        fn main(@builtin(local_invocation_index) i: u32) {
            if HAS_TILE { tile[i % SIZE] = i; workgroupBarrier(); out[i] = tile[0]; }
        }
        @compute @workgroup_size(1) fn aside() { out[0] = u32(UNUSED); }";
    for (has_tile, globals) in [(0.0, 0), (1.0, 2)] {
        let module = specialized(text, &[("SIZE", 8.0), ("HAS_TILE", has_tile)], wgpu::Features::empty());
        assert_eq!(module.entry_points.len(), 1);
        assert_eq!(module.entry_points[0].workgroup_size, [4, 32, 1]);
        assert_eq!((module.global_variables.len(), branches(&module)), (globals, 0));
    }
}

/// Values that a boolean may have: false, true.
type Values = [bool; 2];

const ANY: Values = [true; 2];

fn join(a: Values, b: Values) -> Values {
    [a[0] || b[0], a[1] || b[1]]
}

/// Values of the variables of a function and of results of functions, by joining all that statements store and return.
/// It shares no code with the removal.
struct Facts<'a> {
    module: &'a Module,
    function: &'a Function,
    locals: HashMap<Handle<LocalVariable>, Values>,
    results: &'a HashMap<Handle<Function>, Values>,
}

impl<'a> Facts<'a> {
    fn of(module: &'a Module, function: &'a Function, results: &'a HashMap<Handle<Function>, Values>) -> Self {
        let mut facts = Self { module, function, locals: HashMap::new(), results };
        for (local, variable) in function.local_variables.iter() {
            let initial = variable.init.map_or([variable.name.is_some(), false], |value| facts.may_be(value));
            facts.locals.insert(local, initial);
        }
        loop {
            let before = facts.locals.clone();
            for statement in statements(&function.body) {
                let (pointers, value) = match *statement {
                    Statement::Store { pointer, value } => (vec![pointer], facts.may_be(value)),
                    Statement::Call { ref arguments, .. } => (arguments.clone(), ANY),
                    _ => continue,
                };
                for pointer in pointers {
                    if let Expression::LocalVariable(local) = function.expressions[pointer] {
                        facts.locals.entry(local).and_modify(|values| *values = join(*values, value));
                    }
                }
            }
            if facts.locals == before {
                return facts;
            }
        }
    }

    fn may_be(&self, value: Handle<Expression>) -> Values {
        match self.function.expressions[value] {
            Expression::Literal(Literal::Bool(value)) => [!value, value],
            Expression::Constant(constant) => {
                let constants = &self.module.constants;
                match self.module.global_expressions[constants[constant].init] {
                    Expression::Literal(Literal::Bool(value)) => [!value, value],
                    _ => ANY,
                }
            }
            Expression::Unary { op: UnaryOperator::LogicalNot, expr } => {
                let [no, yes] = self.may_be(expr);
                [yes, no]
            }
            Expression::Binary { op: BinaryOperator::And, left, right } => {
                let ([a, b], [c, d]) = (self.may_be(left), self.may_be(right));
                [a || c, b && d]
            }
            Expression::Binary { op: BinaryOperator::InclusiveOr, left, right } => {
                let ([a, b], [c, d]) = (self.may_be(left), self.may_be(right));
                [a && c, b || d]
            }
            Expression::Load { pointer } => match self.function.expressions[pointer] {
                Expression::LocalVariable(local) => self.locals.get(&local).copied().unwrap_or(ANY),
                _ => ANY,
            },
            Expression::CallResult(callee) => self.results.get(&callee).copied().unwrap_or(ANY),
            _ => ANY,
        }
    }

    fn result(&self) -> Values {
        let returned = statements(&self.function.body).into_iter().filter_map(|statement| match statement {
            Statement::Return { value } => Some(value.map_or(ANY, |value| self.may_be(value))),
            _ => None,
        });
        returned.fold([false; 2], join)
    }

    fn has_known_branch(&self) -> bool {
        let is_known = |condition| self.may_be(condition) != ANY;
        let branches = statements(&self.function.body).into_iter().any(|statement| match *statement {
            Statement::If { condition, .. } => is_known(condition),
            _ => false,
        });
        let selects = self.function.expressions.iter().any(|(_, expression)| match *expression {
            Expression::Select { condition, accept, reject } => accept != reject && is_known(condition),
            _ => false,
        });
        branches || selects
    }
}

/// Returns the functions of a module with branches and selections whose conditions are known.
fn known_branches(module: &Module) -> Vec<&str> {
    let mut results = HashMap::new();
    for (handle, function) in module.functions.iter() {
        let result = Facts::of(module, function, &results).result();
        results.insert(handle, result);
    }
    let found = functions(module).filter(|function| Facts::of(module, function, &results).has_known_branch());
    found.map(|function| function.name.as_deref().unwrap_or("main")).collect()
}

#[test]
fn no_kernel_branches_on_a_known_constant() {
    let of = |name| SceneNeeds::of(&builtin::find(name).unwrap().build());
    let scenes = ["cornell", "atrium", "gallery", "studio"].map(|name| (name, of(name)));
    for (scene, needs) in scenes.into_iter().chain([("all needs", SceneNeeds::ALL)]) {
        let config = RunConfig::new(Extent::new(64, 36), needs);
        for pass in passes::pass_of_each_kernel() {
            for (traversal, jitter) in Traversal::ALL.into_iter().flat_map(|t| [false, true].map(|jitter| (t, jitter)))
            {
                let text = pass_text(&pass, SceneAccess { traversal, ..Default::default() });
                let declared = override_names(&text);
                let constants: Vec<_> = (config.constants(jitter).into_iter())
                    .filter(|(name, _)| declared.contains(name))
                    .map(|(name, on)| (name, f64::from(u8::from(on))))
                    .collect();
                let module = specialized(&text, &constants, traversal.features());
                let of = format!("{} of {scene}, {traversal:?}, JITTER {jitter}", pass.kernel.name);
                assert_eq!(known_branches(&module), [""; 0], "{of}");
                assert!(module.overrides.is_empty(), "{of}");
            }
        }
    }
}

#[test]
fn branches_on_known_constants_are_found() {
    let text = "const OFF = false;
        @group(0) @binding(0) var<storage, read_write> out: array<u32>;
        fn never() -> bool { return OFF; }
        @compute @workgroup_size(1) fn main() { if CONDITION { out[0] = 1u; } }";
    for (condition, is_known) in
        [("OFF", true), ("out[1] > 0u && OFF", true), ("never() & (out[1] > 0u)", true), ("out[1] > 0u", false)]
    {
        let module = naga::front::wgsl::parse_str(&text.replace("CONDITION", condition)).unwrap();
        assert_eq!(!known_branches(&module).is_empty(), is_known, "{condition}");
    }
}

#[test]
fn rejects_faulty_shaders_with_the_line() {
    let mut gpu = device::open(&Selection { virtual_devices: 1, ..Selection::default() }).unwrap().remove(0);
    let config = RunConfig::new(Extent::new(8, 8), SceneNeeds::ALL);
    let layout = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: None,
        entries: &[buffer_entry(0, wgpu::BufferBindingType::Uniform)],
    });
    const GREY: Resource = Resource::image::<u32>("grey");
    let mut refused = |text: &'static str| {
        let pass = Pass::new(Stage("grey"), Eye::LEFT, tonemap::PARTITION, Kernel::from_text("grey", text));
        match build(&mut gpu, &pass.uses([Use::write(GREY)]), &layout, &config) {
            Err(StageError::Pipeline { what, .. }) => what,
            Err(other) => panic!("{other}"),
            Ok(_) => String::new(),
        }
    };
    const HEAD: &str = "//!include bindings\n@compute @workgroup_size(8, 8)\n";
    for (rest, line) in [
        ("fn main() { grey[0] = 1.5; }", "grey[0] = 1.5"),
        ("fn main() { grey[0] = gray(); }", "grey[0] = gray()"),
        ("fn main() { if false { grey[0] = vec2(1u); } }", "grey[0] = vec2(1u)"),
        ("fn main() { grey[0] = 1u }", "grey[0] = 1u }"),
        ("fn aside() { subgroupBarrier(); }\n@compute @workgroup_size(1) fn main() {}", "subgroupBarrier()"),
        ("fn main() { grey[0] = u32(LEVEL); }\noverride LEVEL: f32;", "LEVEL"),
        ("fn main() {}\n@group(1) @binding(1) var<storage> x: array<u32>;\nfn f() { x[0] = 1u; }", "x[0] = 1u"),
    ] {
        let error = refused(format!("{HEAD}{rest}").leak());
        assert!(error.contains(line), "{rest}: {error:?}");
    }
    assert_eq!(refused(format!("{HEAD}fn main() {{ grey[0] = 1u; }}").leak()), "");
}
