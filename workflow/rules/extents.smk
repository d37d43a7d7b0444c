"""What a run makes: the content of the paper, what goes beyond it, or both."""

# The default is the content of the paper. A configuration file on the command line asks for what it
# contains, which is then the default.
AS_SHIPPED = not workflow.overwrite_configfiles


rule paper:
    input:
        rules.architecture_table.output if OPTIMIZERS else [],
        rules.architecture_claims.output if OF_THE_PAPER else [],
        [results(cell.path) for cell in EXTENTS["paper/"]],
        rules.tracking_table_of_paper.output if EXTENTS["paper/"] else [],
        rules.tasking_comparison.output if COMPARED["scenario"] else [],
        expand(
            rules.paper_vs_ours.output + rules.results_page.output,
            extent="paper/" if EXTENTS["paper/"] and OF_THE_PAPER else [],
        ),
        rules.paper_figures.input,


EVERYTHING = [
    *rules.task1.input,
    *rules.task2.input,
    *expand(rules.paper_vs_ours.output, extent="" if OF_THE_PAPER else []),
    *expand(rules.results_page.output, extent="" if CELLS and OF_THE_PAPER else []),
    *rules.sweeps.input,
    *rules.figures.input,
]


rule beyond:
    input:
        [made for made in EVERYTHING if made not in set(map(str, rules.paper.input))],


rule everything:
    input:
        rules.paper.input,
        EVERYTHING,
