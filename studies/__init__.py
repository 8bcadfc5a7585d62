"""What the models and the loop can do, measured: accuracy, stability, the body and the rates for a budget."""
