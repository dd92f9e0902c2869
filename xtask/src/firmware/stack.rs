//! How much stack an image for a Cortex-M needs, read off its machine code: the frame of each function and which
//! functions it calls.
//!
//! Calls by pointers are not seen, but most of a node's are known. The thread's executor polls the tasks: the task of the
//! program's `main`, which starts before the ranging does, and others, which the ranging interrupts. A frame of the
//! processor's registers is beneath each interrupt. All interrupts but ranging's are counted as one, the deepest.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::{Context, Result, ensure};
use object::read::{Object, ObjectSection, ObjectSymbol};
use object::{File, SectionKind, SymbolKind};

/// What the processor puts on the stack at an interrupt, with the registers of the floating-point unit, aligned, bytes.
const INTERRUPT: u64 = 108;
/// A function that the task calls which takes the board: that of `main`.
const OF_MAIN: &str = "::Board::take";
/// The function of `main` itself, where it is not a part of its task's.
const MAIN: &str = "embassy_main";
/// A function that the task calls which owns the radio.
const OF_RANGING: &str = "ranging::node::attempt";
/// How a task is called.
const TASK: [&str; 2] = ["embassy_executor::raw::TaskStorage", "::poll"];
/// Protocols are called by pointers where a board has two roles.
const PROTOCOL: [&str; 2] = ["", "ranging::exchange::Protocol::step"];

/// The most stack that an image needs, bytes.
///
/// # Errors
/// The image lacks one of the tasks, or a function's frame cannot be read.
pub fn needed(elf: &File<'_>) -> Result<u64> {
    let program = Program::read(elf)?;
    let of = |start: u32, part: &str| program.below(start).into_iter().any(|function| program.is(function, part));
    let tasks: Vec<u32> = program.named(TASK).collect();
    let (starting, running): (Vec<u32>, Vec<u32>) = tasks.iter().partition(|&&task| of(task, OF_MAIN));
    let (ranging, beside): (Vec<u32>, Vec<u32>) = running.iter().partition(|&&task| of(task, OF_RANGING));
    ensure!(!starting.is_empty(), "no task calls {OF_MAIN}");
    let deepest = |functions: &[u32]| functions.iter().map(|&function| program.depth(function)).max().unwrap_or(0);
    let steps: Vec<u32> = program.named(PROTOCOL).filter(|step| !program.is_called(*step)).collect();
    let ranging = INTERRUPT + deepest(&ranging) + deepest(&steps);
    // The executor polls a task by a pointer, out of the function that never returns.
    let executor = deepest(&program.named(["main", "main"]).collect::<Vec<_>>());
    let main_itself = starting.iter().flat_map(|&task| program.below(task));
    let main_itself = main_itself.filter(|&function| tasks.contains(&function) || program.is(function, MAIN));
    let main_itself: u64 = main_itself.map(|function| program.functions[&function].frame).sum();
    let thread = deepest(&starting).max(main_itself + ranging).max(deepest(&beside) + ranging);
    let others = INTERRUPT + deepest(&program.interrupts(elf)?);
    Ok(executor + thread + others)
}

/// A function of an image.
#[derive(Debug, Default)]
struct Function {
    name: String,
    /// Bytes that it has on the stack.
    frame: u64,
    /// Where the functions begin that it calls, or goes on with.
    calls: BTreeSet<u32>,
}

/// The functions of an image, by their addresses.
struct Program {
    functions: BTreeMap<u32, Function>,
}

impl Program {
    fn read(elf: &File<'_>) -> Result<Self> {
        let mut ends = BTreeMap::new();
        let mut functions = BTreeMap::new();
        for symbol in elf.symbols().filter(|symbol| symbol.kind() == SymbolKind::Text && symbol.size() > 0) {
            let begin = symbol.address() as u32 & !1;
            // Compilers put the angle brackets in different places.
            let name = format!("{:#}", rustc_demangle::demangle(symbol.name()?)).replace(['<', '>'], "");
            ends.insert(begin, begin + symbol.size() as u32);
            functions.insert(begin, Function { name, ..Function::default() });
        }
        let holder = |address: u32| {
            let (&begin, &end) = ends.range(..=address).next_back()?;
            (address < end).then_some(begin)
        };
        // Constants are between the instructions: a mapping symbol stands where they begin, and where they end.
        let mapping =
            |name: &str| ["$t", "$d"].into_iter().find(|kind| name == *kind || name.starts_with(&format!("{kind}.")));
        let marks =
            elf.symbols().filter_map(|symbol| Some((symbol.address() as u32 & !1, mapping(symbol.name().ok()?)?)));
        let marks: BTreeMap<u32, &str> = marks.collect();
        let is_code = |address: u32| marks.range(..=address).next_back().is_none_or(|(_, mark)| *mark == "$t");
        for section in elf.sections().filter(|section| section.kind() == SectionKind::Text) {
            let bytes = section.data()?;
            let origin = section.address() as u32;
            let half = |address: u32| {
                let place = (address - origin) as usize;
                let pair = bytes.get(place..place + 2)?;
                Some(u16::from_le_bytes([pair[0], pair[1]]))
            };
            let mut address = origin;
            while let Some(first) = half(address) {
                let is_long = first >> 11 > 0b11100;
                let second = if is_long { half(address + 2).unwrap_or(0) } else { 0 };
                let function = holder(address).filter(|_| is_code(address)).and_then(|begin| functions.get_mut(&begin));
                if let Some(function) = function {
                    let step = Step::of(first, second).with_context(|| format!("{} at {address:#x}", function.name))?;
                    function.frame += u64::from(step.pushed);
                    let target = step.branch.and_then(|offset| holder(address.wrapping_add_signed(offset)));
                    function.calls.extend(target.filter(|begin| holder(address) != Some(*begin)));
                }
                // Constants may look like the first half of an instruction.
                address += if is_long && is_code(address) { 4 } else { 2 };
            }
        }
        ensure!(!functions.is_empty(), "no function has a symbol");
        Ok(Self { functions })
    }

    /// The functions whose names begin and end so.
    fn named<'n>(&self, [begin, end]: [&'n str; 2]) -> impl Iterator<Item = u32> + use<'_, 'n> {
        let is_named = move |name: &str| name.starts_with(begin) && name.ends_with(end);
        self.functions.iter().filter(move |(_, function)| is_named(&function.name)).map(|(begin, _)| *begin)
    }

    fn is(&self, begin: u32, part: &str) -> bool {
        self.functions[&begin].name.contains(part)
    }

    fn is_called(&self, begin: u32) -> bool {
        self.functions.values().any(|function| function.calls.contains(&begin))
    }

    /// The function and all that it may call.
    fn below(&self, begin: u32) -> BTreeSet<u32> {
        let (mut found, mut next) = (BTreeSet::from([begin]), vec![begin]);
        while let Some(function) = next.pop() {
            next.extend(self.functions[&function].calls.iter().filter(|call| found.insert(**call)));
        }
        found
    }

    /// The stack that a function takes with all that it calls, bytes. Where functions call each other in a circle, one
    /// round counts.
    fn depth(&self, begin: u32) -> u64 {
        self.depth_below(begin, &mut BTreeSet::new(), &mut BTreeMap::new())
    }

    fn depth_below(&self, begin: u32, above: &mut BTreeSet<u32>, known: &mut BTreeMap<u32, u64>) -> u64 {
        if let Some(depth) = known.get(&begin) {
            return *depth;
        }
        if !above.insert(begin) {
            return 0;
        }
        let Function { frame, calls, .. } = &self.functions[&begin];
        let depth = frame + calls.iter().map(|call| self.depth_below(*call, above, known)).max().unwrap_or(0);
        above.remove(&begin);
        known.insert(begin, depth);
        depth
    }

    /// The functions in the table of vectors, but the start.
    fn interrupts(&self, elf: &File<'_>) -> Result<Vec<u32>> {
        let table = elf.section_by_name(".vector_table").context("no vector table")?.data()?;
        let words = table.chunks_exact(4).skip(2).map(|word| u32::from_le_bytes([word[0], word[1], word[2], word[3]]));
        Ok(words.map(|word| word & !1).filter(|begin| self.functions.contains_key(begin)).collect())
    }
}

/// What an instruction of Thumb does to the stack, and where it goes on.
#[derive(Debug, Default, PartialEq, Eq)]
struct Step {
    /// Bytes.
    pushed: u32,
    /// From the instruction to the place where it may go on.
    branch: Option<i32>,
}

impl Step {
    /// Encodings: Armv7-M Architecture Reference Manual (DDI 0403), A7.7.
    fn of(first: u16, second: u16) -> Result<Self> {
        let pushed = |bytes: u32| Ok(Self { pushed: bytes, branch: None });
        let branch = |offset: i32| Ok(Self { pushed: 0, branch: Some(4 + offset) });
        let (high, low) = (u32::from(first), u32::from(second));
        let signed = |value: u32, bits: u32| ((value << (32 - bits)) as i32) >> (32 - bits);
        // An immediate of twelve bits in three parts.
        let immediate = (high >> 10 & 1) << 11 | (low >> 12 & 7) << 8 | low & 0xFF;
        let is_of_stack = low >> 8 & 0xF == 13;
        let far = |bits: u32| (low >> 13 & 1, low >> 11 & 1, bits);
        match (first, second) {
            // PUSH, SUB SP, B.
            (0xB400..=0xB5FF, _) => pushed(4 * (high & 0x1FF).count_ones()),
            (0xB080..=0xB0FF, _) => pushed(4 * (high & 0x7F)),
            (0xD000..=0xDDFF, _) => branch(signed(2 * (high & 0xFF), 9)),
            (0xE000..=0xE7FF, _) => branch(signed(2 * (high & 0x7FF), 12)),
            // PUSH.W, STR [SP, #-4]!, VPUSH.
            (0xE92D, _) => pushed(4 * low.count_ones()),
            (0xF84D, _) if low & 0xFFF == 0xD04 => pushed(4),
            (0xED2D | 0xED6D, _) if low & 0xE00 == 0xA00 => pushed(4 * (low & 0xFF)),
            // SUB.W SP and SUBW SP with an immediate.
            (0xF1AD | 0xF5AD, _) if is_of_stack => pushed(expanded(immediate)),
            (0xF2AD | 0xF6AD, _) if is_of_stack => pushed(immediate),
            (0xEBAD, _) => {
                ensure!(!is_of_stack, "a frame of a size that is computed");
                Ok(Self::default())
            }
            // BL and B.W, then B.W with a condition.
            (0xF000..=0xF7FF, _) if low & 0x9000 == 0x9000 => {
                let (j1, j2, s) = far(high >> 10 & 1);
                let (i1, i2) = (1 ^ j1 ^ s, 1 ^ j2 ^ s);
                branch(signed(s << 24 | i1 << 23 | i2 << 22 | (high & 0x3FF) << 12 | (low & 0x7FF) << 1, 25))
            }
            (0xF000..=0xF7FF, _) if low & 0xD000 == 0x8000 && high >> 6 & 0xF < 14 => {
                let (j1, j2, s) = far(high >> 10 & 1);
                branch(signed(s << 20 | j2 << 19 | j1 << 18 | (high & 0x3F) << 12 | (low & 0x7FF) << 1, 21))
            }
            _ => Ok(Self::default()),
        }
    }
}

/// The value of a modified immediate (A5.3.2).
fn expanded(immediate: u32) -> u32 {
    let byte = immediate & 0xFF;
    match immediate >> 8 {
        0 => byte,
        1 => byte << 16 | byte,
        2 => byte << 24 | byte << 8,
        3 => byte << 24 | byte << 16 | byte << 8 | byte,
        _ => (0x80 | byte & 0x7F).rotate_right(immediate >> 7),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_read_as_a_disassembler_reads_them() {
        // What llvm-objdump prints for these.
        let pushed = |first, second| Step::of(first, second).unwrap().pushed;
        assert_eq!(pushed(0xB5F0, 0), 20, "push {{r4, r5, r6, r7, lr}}");
        assert_eq!(pushed(0xE92D, 0x0F00), 16, "push.w {{r8, r9, r10, r11}}");
        assert_eq!(pushed(0xF84D, 0xBD04), 4, "str r11, [sp, #-4]!");
        assert_eq!(pushed(0xED2D, 0x8B04), 16, "vpush {{d8, d9}}");
        assert_eq!(pushed(0xB082, 0), 8, "sub sp, #8");
        assert_eq!(pushed(0xF5AD, 0x5D80), 4096, "sub.w sp, sp, #4096");
        assert_eq!(pushed(0xF6AD, 0x1DCC), 2508, "subw sp, sp, #2508");
        assert_eq!(pushed(0xF1AD, 0x0004), 0, "sub.w r0, sp, #4");
        assert!(Step::of(0xEBAD, 0x0D01).is_err(), "sub.w sp, sp, r1");
    }

    #[test]
    fn branches_are_read_as_a_disassembler_reads_them() {
        let branch = |first, second| Step::of(first, second).unwrap().branch;
        assert_eq!(branch(0xF000, 0xF801), Some(6), "bl");
        assert_eq!(branch(0xF7FF, 0xFFFE), Some(0), "bl to itself");
        assert_eq!(branch(0xF7FF, 0xBFFC), Some(-4), "b.w");
        assert_eq!(branch(0xE7FE, 0), Some(0), "b to itself");
        assert_eq!(branch(0xD0FE, 0), Some(0), "beq to itself");
        assert_eq!(branch(0xF43F, 0xAFFE), Some(0), "beq.w to itself");
        assert_eq!(branch(0x4770, 0), None, "bx lr");
    }
}
