/** For tests of the package itself in a browser. */
import * as gravisight from "gravisight";

Object.assign(window, { gravisight });
