"""What the paper reports, quoted beside our own figures; nothing here was measured by us."""

PUBLISHED = """\
## Published figures, for orientation

**Not measured here.** Quoted from Zhan et al., "Homography Decomposition Networks for Planar Object Tracking" (AAAI
2022), its tables 1 and 2 and its ablation. The data sets cannot be shipped; `hdn-eval` reads their layouts, and runs
the authors' networks (`hdn-authors`, with weights that `hdn-import` makes of their checkpoint). The clips above are
others, so that figures above and below do not compare.

POT-210:

| tracker | avg Prec | P<=5 | P<=10 | P<=20 | avg HSR | avg CP | avg SR |
|---|---|---|---|---|---|---|---|
| HDN (the paper) | 0.841 | 0.611 | 0.870 | 0.928 | 0.710 | 0.886 | 0.904 |
| LISRD | 0.752 | 0.617 | 0.759 | 0.815 | 0.619 | 0.788 | 0.805 |
| GIFT | 0.745 | 0.551 | 0.741 | 0.815 | 0.580 | 0.785 | 0.801 |
| SIFT | 0.670 | 0.622 | 0.695 | 0.719 | 0.570 | 0.698 | 0.701 |
| SURF | 0.657 | 0.543 | 0.663 | 0.711 | 0.536 | 0.689 | 0.705 |
| FERNS | 0.657 | 0.565 | 0.673 | 0.706 | 0.601 | 0.686 | 0.724 |
| Gracker | 0.611 | 0.392 | 0.560 | 0.668 | 0.527 | 0.684 | 0.716 |
| SuperGlue | 0.552 | 0.389 | 0.526 | 0.601 | 0.509 | 0.592 | 0.659 |
| LDES | 0.510 | 0.028 | 0.196 | 0.531 | 0.518 | 0.617 | 0.737 |
| GOP-ESM | 0.464 | 0.430 | 0.492 | 0.499 | 0.442 | 0.484 | 0.497 |
| TransT | 0.464 | 0.090 | 0.276 | 0.486 | 0.381 | 0.764 | 0.774 |

The paper's parts alone, POT-210, and speed on the authors' GPU:

| stages | avg Prec | frames/s |
|---|---|---|
| similarity | 0.689 | 13.7 |
| residual | 0.319 | 21.2 |
| both | 0.841 | 10.6 |

POIC:

| tracker | avg Prec | P<=5 | P<=10 | P<=20 | avg CP | avg SR |
|---|---|---|---|---|---|---|
| HDN (the paper) | 0.874 | 0.749 | 0.894 | 0.948 | 0.916 | 0.923 |
| GOP-ESM | 0.873 | 0.868 | 0.893 | 0.901 | 0.889 | 0.882 |
| Gracker | 0.819 | 0.671 | 0.829 | 0.878 | 0.870 | 0.871 |
| SIFT | 0.527 | 0.400 | 0.520 | 0.573 | 0.547 | 0.570 |
| TransT | 0.367 | 0.047 | 0.185 | 0.366 | 0.722 | 0.709 |

UCSB:

| tracker | avg Prec | P<=5 | P<=10 | P<=20 | avg CP | avg SR |
|---|---|---|---|---|---|---|
| HDN (the paper) | 0.871 | 0.660 | 0.916 | 0.964 | 0.912 | 0.887 |
| Gracker | 0.837 | 0.648 | 0.831 | 0.903 | 0.885 | 0.859 |
| GOP-ESM | 0.528 | 0.487 | 0.519 | 0.552 | 0.575 | 0.579 |
| TransT | 0.422 | 0.000 | 0.001 | 0.141 | 0.908 | 0.565 |
"""
