"""From a workflow to a plan: parameters, design space, cases. Runs nothing."""
