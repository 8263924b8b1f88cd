/** The places whose scenes the core knows, as people call them. */
export const SPORTS: readonly (readonly [name: string, label: string])[] = [
  ["tennis", "Tennis"],
  ["table-tennis", "Table tennis"],
  ["basketball", "Basketball"],
  ["football", "Football"],
  ["volleyball", "Volleyball"],
  ["badminton", "Badminton"],
  ["squash", "Squash"],
  ["pickleball", "Pickleball"],
  ["padel", "Padel"],
  ["cricket", "Cricket"],
  ["floor", "A level floor"],
  ["free", "Free flight, no surfaces"],
];
