//! Tests of the core against recorded data, of the ELF on the virtual board, and of the pages. One program: it is linked once.

mod believes;
mod bench;
mod bring_up;
mod browser;
mod by_choice;
mod chamber;
mod chip;
mod corpus;
mod day;
mod docs;
mod elf;
mod faults;
mod foreign;
mod layout;
mod library;
mod measured;
mod ocxo;
mod panics;
mod papers;
mod parquet;
mod rates;
mod second_chip;
mod signed;
mod table1;
mod words;
mod wu2023;
