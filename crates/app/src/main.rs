//! The program `umbra`.

use std::process::ExitCode;

fn main() -> ExitCode {
    if let Err(lacks) = check_processor() {
        app::progress::note(lacks);
        return ExitCode::FAILURE;
    }
    app::cli::main()
}

/// Whether the processor has the instructions that the program is compiled to.
fn check_processor() -> Result<(), &'static str> {
    #[cfg(all(target_arch = "x86_64", target_feature = "avx2"))]
    {
        // The standard library's own check answers what the compiler was told, not what the processor says.
        let has_avx2 =
            raw_cpuid::CpuId::new().get_extended_feature_info().is_some_and(|features| features.has_avx2());
        if !has_avx2 {
            return Err(
                "umbra: the processor has no AVX2, expected one of 2013 or later; build without .cargo/config.toml for it",
            );
        }
    }
    Ok(())
}
