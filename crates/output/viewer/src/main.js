// The page of a run: a finished one, whose data came as a script, or one that goes on.

import { showRun } from "./finished.js";
import { watch } from "./live.js";
import { Run } from "./run.js";

if (window.splatsegRun) showRun(new Run(window.splatsegRun));
else watch();
