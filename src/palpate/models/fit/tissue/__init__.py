"""Material parameters of soft tissue and phantoms from measured presses: `palpate fit tissue`."""
