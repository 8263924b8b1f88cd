/** For tests of the package itself in a browser. */
import { GravisightError, Localiser } from "gravisight";

Object.assign(window, { gravisight: { GravisightError, Localiser } });
