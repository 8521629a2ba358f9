//! The `wavecast` program: arguments in, exit code out.

mod cli;

use std::process::ExitCode;

/// Asks the processor before anything else runs: code after this may use what it answers for.
fn main() -> ExitCode {
    #[cfg(all(target_arch = "x86_64", target_feature = "avx2"))]
    if !has_x86_64_v3() {
        eprintln!(
            "error: this build needs a processor with AVX2, FMA and BMI2 (x86-64-v3, from 2013 on), and this one lacks \
             them; build with RUSTFLAGS=\"-C target-cpu=x86-64\" for a slower program that runs here"
        );
        return ExitCode::FAILURE;
    }
    cli::run()
}

/// True if the processor has what the compiler was allowed to use.
///
/// `is_x86_feature_detected!` will not do: where the compiler may use a feature anyway, it is true
/// without asking.
#[cfg(all(target_arch = "x86_64", target_feature = "avx2"))]
#[inline(never)]
fn has_x86_64_v3() -> bool {
    use std::arch::x86_64::__cpuid;
    // Bits as in the processor manuals, leaves 1, 7 and 0x8000_0001.
    const FMA_MOVBE_OSXSAVE_AVX_F16C: u32 = 1 << 12 | 1 << 22 | 1 << 27 | 1 << 28 | 1 << 29;
    const BMI1_AVX2_BMI2: u32 = 1 << 3 | 1 << 5 | 1 << 8;
    const LZCNT: u32 = 1 << 5;
    __cpuid(0).eax >= 7
        && __cpuid(1).ecx & FMA_MOVBE_OSXSAVE_AVX_F16C == FMA_MOVBE_OSXSAVE_AVX_F16C
        && __cpuid(7).ebx & BMI1_AVX2_BMI2 == BMI1_AVX2_BMI2
        && __cpuid(0x8000_0000).eax > 0x8000_0000
        && __cpuid(0x8000_0001).ecx & LZCNT == LZCNT
}
