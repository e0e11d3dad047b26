use anyhow::bail;
use covista_perception::{OnnxRuntime, list_models, verify_model};

use crate::{
    cli::{ModelsArgs, ModelsWhat},
    output::{models_folder, say},
};

/// `covista models`.
pub fn run(args: &ModelsArgs) -> anyhow::Result<()> {
    let folder = models_folder(args.models.as_deref());
    let cards = list_models(&folder)?;
    if cards.is_empty() {
        bail!(
            "no model card (*.toml) in {}; name the folder with --models",
            folder.display()
        );
    }
    let runtime = match args.what {
        ModelsWhat::List => None,
        ModelsWhat::Verify => Some(OnnxRuntime::acquire(&|message| {
            eprintln!("covista: {message}");
        })?),
    };
    let width = cards.iter().map(|card| card.id.len()).max().unwrap_or(0);
    for card in &cards {
        if let Some(runtime) = &runtime {
            verify_model(runtime, card)?;
        }
        let verdict = if runtime.is_some() { "  ok" } else { "" };
        let cost = card.cost.map_or_else(String::new, |cost| {
            format!(
                " ({:.2} GMAC, {:.2} M parameters)",
                cost.multiply_accumulates as f64 / 1e9,
                cost.parameters as f64 / 1e6
            )
        });
        say(&format!(
            "{:<width$}  {}{cost}{verdict}",
            card.id, card.description
        ))?;
    }
    Ok(())
}
