//! Removes code that cannot run from a module whose override constants have their values.
//!
//! A kernel contains the code of every material, light and setting, behind override constants. Drivers remove what is
//! behind a false constant, but late: they first read and inline all of it, and some reserve workgroup memory for each
//! inlined ray query that they remove afterwards. Neither naga nor wgpu removes it before.
//!
//! The method is conditional constant propagation (Wegman and Zadeck, "Constant propagation with conditional
//! branches", TOPLAS 1991), restricted to booleans and repeated until nothing changes, instead of their single pass
//! with a work list. A boolean is known if it is
//! - a literal, a constant, or an operation whose known operands determine its value,
//! - loaded from a local variable to which only one value is ever stored. naga lowers `a && b` and `a || b` to a
//!   variable without a name, which an `if` over `a` sets in both of its branches,
//! - the result of a function without side effects that returns the same known value everywhere.

use std::collections::{HashMap, HashSet};
use std::mem;

use wgpu::naga::compact::{KeepUnused, compact};
use wgpu::naga::{
    Arena, BinaryOperator, Block, Constant, Expression, Function, Handle, Literal, LocalVariable, Module, Range,
    Scalar, Statement, Type, TypeInner, UnaryOperator, UniqueArena,
};

/// Removes branches whose conditions are known, statements that are never reached, and the functions, global variables
/// and types that nothing uses any more. Entry points keep their names and workgroup sizes.
///
/// `module` must be valid, without overrides that a condition depends on. It stays valid.
pub fn remove_dead_code(module: &mut Module) {
    // Compaction removes loads that nothing uses, after which more variables are never loaded.
    loop {
        let has_changed = fold(module);
        compact(module, KeepUnused::No);
        if !has_changed {
            return;
        }
    }
}

/// Removes branches and statements. Returns true if it found any.
fn fold(module: &mut Module) -> bool {
    let Module { types, constants, global_expressions, functions, entry_points, .. } = module;
    let (pure, results) = Default::default();
    let mut fold = Fold { types, constants, global_expressions, pure, results };
    let mut has_changed = false;
    // A function precedes its callers in the arena, so all callees are known when they are asked for.
    for (handle, function) in functions.iter_mut() {
        has_changed |= fold.function(function);
        if fold.is_pure(&function.body, &function.expressions) {
            fold.pure.insert(handle);
            let mut returned = Vec::new();
            add_returned(&function.body, &mut returned);
            if let Some(value) = same(returned.into_iter().map(|value| as_literal(&function.expressions[value]))) {
                fold.results.insert(handle, value);
            }
        }
    }
    entry_points.iter_mut().for_each(|entry| has_changed |= fold.function(&mut entry.function));
    has_changed
}

struct Fold<'a> {
    types: &'a UniqueArena<Type>,
    constants: &'a Arena<Constant>,
    global_expressions: &'a Arena<Expression>,
    /// Functions without side effects.
    pure: HashSet<Handle<Function>>,
    /// Known results of functions without side effects.
    results: HashMap<Handle<Function>, bool>,
}

/// Facts about the boolean local variables of a function.
#[derive(Default)]
struct Locals {
    /// Variables that hold the same value wherever they are loaded.
    known: HashMap<Handle<LocalVariable>, bool>,
    /// Variables that are never loaded.
    unread: HashSet<Handle<LocalVariable>>,
}

impl Fold<'_> {
    /// Folds until nothing changes. Returns true if anything did.
    fn function(&self, function: &mut Function) -> bool {
        // Names of values keep these alive, and compaction refuses names of values that are never computed.
        function.named_expressions.clear();
        for round in 0.. {
            let locals = self.locals(function);
            let has_changed = self.replace_known(function, &locals);
            let mut body = mem::take(&mut function.body);
            let mut blocks = Blocks { expressions: &function.expressions, locals: &locals, fold: self, has_changed };
            blocks.fold(&mut body);
            let has_changed = blocks.has_changed;
            function.body = body;
            if !has_changed {
                return round > 0;
            }
        }
        unreachable!("each round makes the function smaller")
    }

    /// Returns true if a block changes nothing but local variables.
    fn is_pure(&self, block: &Block, arena: &Arena<Expression>) -> bool {
        block.iter().all(|statement| match statement {
            Statement::Emit(_) | Statement::Return { .. } | Statement::Break | Statement::Continue => true,
            Statement::Store { pointer, .. } => is_local(*pointer, arena),
            Statement::Call { function, .. } => self.pure.contains(function),
            _ => {
                let inside = children(statement);
                !inside.is_empty() && inside.into_iter().all(|child| self.is_pure(child, arena))
            }
        })
    }

    fn locals(&self, function: &Function) -> Locals {
        let is_bool = |ty: Handle<Type>| self.types[ty].inner == TypeInner::Scalar(Scalar::BOOL);
        let mut uses = Uses::default();
        uses.add(&function.body, &function.expressions);
        let mut locals = Locals::default();
        for (local, variable) in function.local_variables.iter() {
            if !is_bool(variable.ty) || uses.passed.contains(&local) {
                continue;
            }
            if !uses.loaded.contains(&local) {
                locals.unread.insert(local);
            }
            let literal = |value: Handle<Expression>| as_literal(&function.expressions[value]);
            // Variables start as false without a value of their own. Those of `&&` and `||`, which have no name, are
            // set before they are loaded.
            let initial = match variable.init {
                Some(value) => Some(literal(value)),
                None => variable.name.as_ref().map(|_| Some(false)),
            };
            let stored = uses.stored.get(&local).into_iter().flatten().map(|&value| literal(value));
            if let Some(value) = same(initial.into_iter().chain(stored)) {
                locals.known.insert(local, value);
            }
        }
        locals
    }

    /// Replaces known booleans by literals, and both arms of a selection with a known condition by the chosen one.
    /// Returns true if it found any.
    fn replace_known(&self, function: &mut Function, locals: &Locals) -> bool {
        let handles: Vec<_> = function.expressions.iter().map(|(handle, _)| handle).collect();
        let mut has_changed = false;
        for handle in handles {
            let arena = &function.expressions;
            let new = match arena[handle] {
                Expression::Literal(_) => continue,
                Expression::Select { condition, accept, reject } if accept != reject => {
                    let chosen = as_literal(&arena[condition]).map(|known| if known { accept } else { reject });
                    chosen.map(|chosen| Expression::Select { condition, accept: chosen, reject: chosen })
                }
                ref expression => {
                    self.value(expression, arena, locals).map(|value| Expression::Literal(Literal::Bool(value)))
                }
            };
            if let Some(new) = new {
                function.expressions[handle] = new;
                has_changed = true;
            }
        }
        has_changed
    }

    /// Returns the value of a boolean expression if it is known.
    fn value(&self, expression: &Expression, arena: &Arena<Expression>, locals: &Locals) -> Option<bool> {
        let literal = |handle: Handle<Expression>| as_literal(&arena[handle]);
        match *expression {
            Expression::Constant(constant) => self.constant(constant),
            Expression::ZeroValue(ty) => (self.types[ty].inner == TypeInner::Scalar(Scalar::BOOL)).then_some(false),
            Expression::Unary { op: UnaryOperator::LogicalNot, expr } => literal(expr).map(|value| !value),
            Expression::Binary { op, left, right } => binary(op, literal(left), literal(right)),
            Expression::Select { accept, reject, .. } if accept == reject => literal(accept),
            Expression::Load { pointer } => match arena[pointer] {
                Expression::LocalVariable(local) => locals.known.get(&local).copied(),
                _ => None,
            },
            // The statement that calls the function goes too.
            Expression::CallResult(function) => self.results.get(&function).copied(),
            _ => None,
        }
    }

    fn constant(&self, constant: Handle<Constant>) -> Option<bool> {
        let value = &self.global_expressions[self.constants[constant].init];
        match *value {
            Expression::Constant(other) => self.constant(other),
            Expression::ZeroValue(ty) => (self.types[ty].inner == TypeInner::Scalar(Scalar::BOOL)).then_some(false),
            _ => as_literal(value),
        }
    }
}

fn as_literal(expression: &Expression) -> Option<bool> {
    match *expression {
        Expression::Literal(Literal::Bool(value)) => Some(value),
        _ => None,
    }
}

fn binary(op: BinaryOperator, left: Option<bool>, right: Option<bool>) -> Option<bool> {
    match (op, left, right) {
        (BinaryOperator::And | BinaryOperator::LogicalAnd, Some(false), _)
        | (BinaryOperator::And | BinaryOperator::LogicalAnd, _, Some(false)) => Some(false),
        (BinaryOperator::InclusiveOr | BinaryOperator::LogicalOr, Some(true), _)
        | (BinaryOperator::InclusiveOr | BinaryOperator::LogicalOr, _, Some(true)) => Some(true),
        (BinaryOperator::And | BinaryOperator::LogicalAnd, Some(a), Some(b)) => Some(a && b),
        (BinaryOperator::InclusiveOr | BinaryOperator::LogicalOr, Some(a), Some(b)) => Some(a || b),
        (BinaryOperator::Equal, Some(a), Some(b)) => Some(a == b),
        (BinaryOperator::NotEqual | BinaryOperator::ExclusiveOr, Some(a), Some(b)) => Some(a != b),
        _ => None,
    }
}

/// Uses of local variables in the statements that are left.
#[derive(Default)]
struct Uses {
    loaded: HashSet<Handle<LocalVariable>>,
    stored: HashMap<Handle<LocalVariable>, Vec<Handle<Expression>>>,
    /// Variables whose pointers go to functions.
    passed: HashSet<Handle<LocalVariable>>,
}

impl Uses {
    fn add(&mut self, block: &Block, arena: &Arena<Expression>) {
        let local = |pointer: Handle<Expression>| match arena[pointer] {
            Expression::LocalVariable(local) => Some(local),
            _ => None,
        };
        for statement in block.iter() {
            match statement {
                Statement::Emit(range) => self.loaded.extend(range.clone().filter_map(|handle| match arena[handle] {
                    Expression::Load { pointer } => local(pointer),
                    _ => None,
                })),
                Statement::Store { pointer, value } => {
                    if let Some(local) = local(*pointer) {
                        self.stored.entry(local).or_default().push(*value);
                    }
                }
                Statement::Call { arguments, .. } => {
                    self.passed.extend(arguments.iter().filter_map(|&argument| local(argument)));
                }
                _ => children(statement).into_iter().for_each(|child| self.add(child, arena)),
            }
        }
    }
}

/// Returns the blocks inside a statement.
pub(super) fn children(statement: &Statement) -> Vec<&Block> {
    match statement {
        Statement::Block(block) => vec![block],
        Statement::If { accept, reject, .. } => vec![accept, reject],
        Statement::Switch { cases, .. } => cases.iter().map(|case| &case.body).collect(),
        Statement::Loop { body, continuing, .. } => vec![body, continuing],
        _ => Vec::new(),
    }
}

/// Rewrites the blocks of a function.
struct Blocks<'a> {
    expressions: &'a Arena<Expression>,
    locals: &'a Locals,
    fold: &'a Fold<'a>,
    has_changed: bool,
}

impl Blocks<'_> {
    /// Returns true if no control flow reaches the end of the block.
    fn fold(&mut self, block: &mut Block) -> bool {
        let mut statements = mem::take(block).span_into_iter();
        let mut ends = false;
        for (mut statement, span) in statements.by_ref() {
            match &mut statement {
                Statement::Emit(range) => {
                    emit(range.clone(), self.expressions, |range| block.push(Statement::Emit(range), span));
                    continue;
                }
                Statement::Block(inner) => ends = self.fold(inner),
                Statement::If { condition, accept, reject } => {
                    if let Some(known) = as_literal(&self.expressions[*condition]) {
                        let mut taken = mem::take(if known { accept } else { reject });
                        ends = self.fold(&mut taken);
                        block.extend_block(taken);
                        self.has_changed = true;
                        if ends {
                            break;
                        }
                        continue;
                    }
                    let both = [self.fold(accept), self.fold(reject)];
                    ends = both == [true; 2];
                    if is_idle(accept) && is_idle(reject) {
                        self.has_changed = true;
                        continue;
                    }
                }
                Statement::Switch { cases, .. } => cases.iter_mut().for_each(|case| {
                    self.fold(&mut case.body);
                }),
                Statement::Loop { body, continuing, .. } => {
                    self.fold(body);
                    self.fold(continuing);
                    // The body of a loop whose condition is false consists of `break`.
                    if matches!(body.split_last(), Some((Statement::Break, before)) if before.iter().all(is_emit)) {
                        self.has_changed = true;
                        continue;
                    }
                }
                Statement::Store { pointer, .. } => {
                    if let Expression::LocalVariable(local) = self.expressions[*pointer]
                        && self.locals.unread.contains(&local)
                    {
                        self.has_changed = true;
                        continue;
                    }
                }
                Statement::Call { function, .. } if self.fold.results.contains_key(function) => {
                    self.has_changed = true;
                    continue;
                }
                Statement::Return { .. } | Statement::Break | Statement::Continue | Statement::Kill => ends = true,
                _ => {}
            }
            block.push(statement, span);
            if ends {
                break;
            }
        }
        self.has_changed |= statements.next().is_some();
        ends
    }
}

/// Calls `push` with the parts of a range without expressions that became literals, which must not be emitted.
fn emit(range: Range<Expression>, arena: &Arena<Expression>, mut push: impl FnMut(Range<Expression>)) {
    let mut finish = |part: Option<(_, _)>| {
        if let Some((first, last)) = part {
            push(Range::new_from_bounds(first, last));
        }
    };
    let mut part = None;
    for handle in range {
        if arena[handle].needs_pre_emit() {
            finish(part.take());
        } else {
            part = Some((part.map_or(handle, |(first, _)| first), handle));
        }
    }
    finish(part);
}

fn is_emit(statement: &Statement) -> bool {
    matches!(statement, Statement::Emit(_))
}

/// Returns true if a block only computes values, which nothing outside of it can use.
fn is_idle(block: &Block) -> bool {
    block.iter().all(is_emit)
}

/// Returns true if a pointer points into a local variable.
fn is_local(pointer: Handle<Expression>, arena: &Arena<Expression>) -> bool {
    match arena[pointer] {
        Expression::LocalVariable(_) => true,
        Expression::Access { base, .. } | Expression::AccessIndex { base, .. } => is_local(base, arena),
        _ => false,
    }
}

/// Appends the values that a block returns.
fn add_returned(block: &Block, values: &mut Vec<Handle<Expression>>) {
    for statement in block.iter() {
        match statement {
            Statement::Return { value } => values.extend(*value),
            _ => children(statement).into_iter().for_each(|child| add_returned(child, values)),
        }
    }
}

/// Returns the value that all of them have; `None` if one is unknown or there are none.
fn same(mut values: impl Iterator<Item = Option<bool>>) -> Option<bool> {
    let first = values.next()??;
    values.all(|value| value == Some(first)).then_some(first)
}
