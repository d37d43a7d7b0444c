rule figures:
    input:
        rules.paper_vs_ours.output,
